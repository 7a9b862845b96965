#include "tones/spectral_votes.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <numeric>
#include <utility>

#include "columns/column_dft.hpp"
#include "core/recently_used.hpp"
#include "ocisac/rows/tone_search.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kPairs = kernels::kColumnPairs<double>, kSignals = 2 * kPairs;  // of a block

// A window, a DFT, and the rows of its spectra.
struct Plan {
  Plan(std::size_t rows, std::size_t length) : window(hann_window(rows)), dft(length), place(length) {
    for (std::size_t row = 0; row < length; ++row) place[dft.order()[row]] = row;
  }

  std::vector<double> window;
  ColumnDft<double> dft;
  std::vector<std::size_t> place;  // row of each frequency, those of −k at length − k
};

std::shared_ptr<const Plan> plan_of(std::size_t rows, std::size_t length) {
  static RecentlyUsed<std::pair<std::size_t, std::size_t>, Plan, 4> kept;
  return kept.get({rows, length}, [&] { return std::make_shared<const Plan>(rows, length); });
}

// Up to kSignals weighted signals as a block of the DFT, and what scales the powers of 2A and 2B to fractions of the
// signals' energies.
struct Block {
  std::vector<double> rows;
  std::array<double, kSignals> scale;

  void fill(std::span<const double> samples, std::span<const double> window, std::size_t length) {
    const double window_sum = std::accumulate(window.begin(), window.end(), 0.0);
    const std::size_t count = samples.size() / window.size();
    rows.resize(length * kSignals);
    std::array<double, kSignals> energies{};
    for (std::size_t n = 0; n < window.size(); ++n) {
      double* row = &rows[n * kSignals];
      for (std::size_t s = 0; s < count; ++s) {
        const double value = samples[s * window.size() + n];
        row[s] = window[n] * value;
        energies[s] += row[s] * value;
      }
      std::fill(row + count, row + kSignals, 0.0);
    }
    std::fill(rows.begin() + static_cast<std::ptrdiff_t>(window.size() * kSignals), rows.end(), 0.0);
    for (std::size_t s = 0; s < kSignals; ++s) scale[s] = s < count ? 0.5 / (window_sum * energies[s]) : 0;
  }

  // Product over the signals of the fractions that a tone of a frequency leaves, each 10⁻⁴ or more. Two signals are the
  // real and the imaginary part of one: 2A(k) = Z(k) + Z*(−k), 2iB(k) = Z(k) − Z*(−k).
  // `positive`, `negative`: rows of the frequency.
  [[nodiscard]] double left_by(std::size_t positive, std::size_t negative) const {
    using Lanes = Eigen::Array<double, kPairs, 1>;
    const auto lanes = [](const double* from) { return Eigen::Map<const Lanes>(from); };
    const double *one = &rows[positive * kSignals], *other = &rows[negative * kSignals];
    const Lanes real = lanes(one), imaginary = lanes(one + kPairs);
    const auto other_real = lanes(other), other_imaginary = lanes(other + kPairs);
    const auto left = [](const auto& of_scale, const auto& a, const auto& b) -> Lanes {
      return 1 - (of_scale * (a.square() + b.square())).min(0.9999);
    };
    const Lanes both = left(lanes(scale.data()), real + other_real, imaginary - other_imaginary) *
                       left(lanes(&scale[kPairs]), imaginary + other_imaginary, real - other_real);
    return std::accumulate(both.begin(), both.end(), 1.0, std::multiplies());
  }
};

}  // namespace

std::vector<double> spectral_votes(std::span<const double> samples, std::size_t rows, std::size_t length) {
  const auto plan = plan_of(rows, length);
  std::vector<double> votes(length / 2 + 1);
  thread_local Block block;  // memory reused from call to call
  for (std::size_t first = 0; first < samples.size(); first += kSignals * rows) {
    const auto these = samples.subspan(first, std::min(kSignals * rows, samples.size() - first));
    block.fill(these, plan->window, length);
    plan->dft.forward(block.rows.data(), std::min(kPairs, these.size() / rows));
    for (std::size_t k = 0; k < votes.size(); ++k)
      votes[k] -= std::log(block.left_by(plan->place[k], plan->place[(length - k) % length]));
  }
  return votes;
}

}  // namespace ocisac
