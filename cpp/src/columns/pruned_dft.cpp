#include "columns/pruned_dft.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <variant>

#include "columns/folding_kernels.hpp"
#include "core/spectrum.hpp"
#include "ocisac/camera/linear_light.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kShortest = 32;  // rows that are left to OpenCV: shorter transforms save nothing more

// The shortest divisor of `rows` from kShortest on, without prime factors above 5 if there is one.
std::size_t length_left(std::size_t rows) {
  std::size_t any = rows;
  for (std::size_t length = std::min(kShortest, rows); length < rows; ++length) {
    if (rows % length != 0) continue;
    any = std::min(any, length);
    if (optimal_dft_length(length) == length) return length;
  }
  return any;
}

// e^{−j2π·part/whole}
std::complex<double> turned(std::size_t part, std::size_t whole) {
  return std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(part % whole) / static_cast<double>(whole));
}

struct Memory {
  std::vector<double> folded, start;
  std::vector<std::complex<double>> signals, spectra;
};

}  // namespace

PrunedDft::PrunedDft(std::size_t rows, std::vector<std::size_t> lines) : rows_(rows), length_(length_left(rows)) {
  const std::size_t folds = rows / length_;
  for (const std::size_t k : lines) {
    Branch branch{std::vector<double>(2 * folds), std::vector<std::complex<double>>(length_), k / folds};
    for (std::size_t j = 0; j < folds; ++j) {
      const auto weight = turned(j * (k % folds), folds);
      branch.weights[j] = weight.real();
      branch.weights[folds + j] = weight.imag();
    }
    for (std::size_t m = 0; m < length_; ++m) branch.twiddle[m] = turned(m * (k % folds), rows);
    branches_.push_back(std::move(branch));
  }
}

void PrunedDft::transform(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
                          const ToneCurve& curve, Columns& to) const {
  thread_local Memory memory;  // reused from call to call
  memory.folded.resize(2 * length_ * count);
  memory.start.resize(count);
  memory.signals.resize(length_ * count);
  memory.spectra.resize(length_ * count);
  to.mean.resize(count);
  to.squares.resize(count);
  to.lines.resize(branches_.size() * count);

  const auto lines_of = [&]<class T>(const kernels::FoldedRows<T>& rows, double dark) {
    for (std::size_t b = 0; b < branches_.size(); ++b) {
      const Branch& branch = branches_[b];
      kernels::fold(rows, branch.weights.data(), memory.folded.data(), {to.mean.data(), to.squares.data()});
      for (std::size_t m = 0; m < length_; ++m) {
        const double* const cosine = &memory.folded[m * count];
        const double* const sine = cosine + length_ * count;
        const double re = branch.twiddle[m].real(), im = branch.twiddle[m].imag();
        for (std::size_t c = 0; c < count; ++c)
          memory.signals[c * length_ + m] = {cosine[c] * re - sine[c] * im, cosine[c] * im + sine[c] * re};
      }
      transform_rows(Transform::forward, memory.signals.data(), memory.spectra.data(), count, length_, length_);
      for (std::size_t c = 0; c < count; ++c) to.lines[b * count + c] = memory.spectra[c * length_ + branch.line];
    }
    const auto length = static_cast<double>(rows_);
    for (std::size_t c = 0; c < count; ++c) {
      const double difference = to.mean[c] / length;
      to.squares[c] = std::max(to.squares[c] - to.mean[c] * difference, 0.0);
      to.mean[c] = static_cast<double>(rows.rows[c]) - dark + difference;
    }
  };

  const std::size_t folds = rows_ / length_;
  const bool in_place = curve.kind == ToneCurve::Kind::linear &&
                        std::visit([](const auto& view) { return view.column_stride == 1; }, frames);
  if (in_place) {
    std::visit(
        [&]<class T>(const FramesView<const T>& view) {
          lines_of(kernels::FoldedRows<T>{view.at(frame, 0, first), view.row_stride, count, folds, length_},
                   curve.dark_level);
        },
        frames);
    return;
  }
  const auto signals = column_signals(frames, frame, first, count, curve);
  std::vector<double> rows(signals.size());
  for (std::size_t n = 0; n < rows_; ++n)
    for (std::size_t c = 0; c < count; ++c) rows[n * count + c] = signals[c * rows_ + n];
  lines_of(kernels::FoldedRows<double>{rows.data(), static_cast<std::ptrdiff_t>(count), count, folds, length_}, 0);
}

}  // namespace ocisac
