#include "lights/light_look.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <span>
#include <type_traits>
#include <variant>

#include "core/legendre.hpp"
#include "core/linear_algebra.hpp"
#include "core/spectrum.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kCells = 8, kHalves = 2;
constexpr std::size_t kSampled = 64;          // columns of a box
constexpr double kRowsACycle = 16;            // of a tone
constexpr std::size_t kWaves = 3;             // 1, cosine, sine
constexpr double kSingular = 1e-10;           // of the largest eigenvalue: a cycle above the box may have two rows only
constexpr std::size_t kTrend = 3;             // degree of the slow light beside a waveform
constexpr std::size_t kPadded = 8;            // times the rows: spectrum of a waveform
constexpr std::size_t kLowest = 2 * kPadded;  // of the spectrum: two cycles in the box

std::size_t ceil_of(std::size_t value, std::size_t step) { return (value + step - 1) / step; }

// Evenly spaced positions from −before·step on.
std::vector<std::ptrdiff_t> positions(std::size_t before, std::size_t count, std::size_t step) {
  std::vector<std::ptrdiff_t> at(count);
  for (std::size_t k = 0; k < count; ++k)
    at[k] = static_cast<std::ptrdiff_t>(step) * (static_cast<std::ptrdiff_t>(k) - static_cast<std::ptrdiff_t>(before));
  return at;
}

std::size_t in_frame(std::ptrdiff_t at, std::size_t length) {
  return static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(at, 0, static_cast<std::ptrdiff_t>(length) - 1));
}

// Sum of the squared differences of following rows, which texture larger than a row hardly enters, and standard
// deviation of a row from it. `rest`: (rows × cells).
double row_noise(std::span<const double> rest, std::size_t cells) {
  double energy = 0;
  for (std::size_t k = cells; k < rest.size(); ++k) energy += (rest[k] - rest[k - cells]) * (rest[k] - rest[k - cells]);
  const auto count = rest.size() > cells ? static_cast<double>(rest.size() - cells) : 1.0;
  return std::sqrt(0.5 * energy / count);
}

double energy_of(std::span<const double> values) {
  return std::inner_product(values.begin(), values.end(), values.begin(), 0.0);
}

}  // namespace

LightCells::LightCells(const FreeBox& box, double dark, std::size_t row_step, std::size_t above) : dark_(dark) {
  const std::size_t step = ceil_of(box.width, kSampled), inner = ceil_of(box.width, step);
  const std::size_t rim = std::max<std::size_t>(inner / kCells, 1);
  const std::size_t cells = std::max<std::size_t>(std::min(kCells, inner / 2), 1);
  columns_ = positions(rim, inner + 2 * rim, step);
  ends_.push_back(rim);
  for (std::size_t cell = 1; cell <= cells; ++cell) ends_.push_back(rim + ceil_of(cell * inner, cells));
  ends_.push_back(columns_.size());
  const std::size_t more = ceil_of(above, row_step);
  rows_ = positions(more, ceil_of(box.height, row_step) + 2 * more, row_step);
}

std::vector<double> LightCells::light(const AnyFramesView& frame, const FreeBox& box) const {
  std::vector<double> light(rows_.size() * cells());
  std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        std::vector<std::ptrdiff_t> offsets(columns_.size());
        for (std::size_t k = 0; k < offsets.size(); ++k)
          offsets[k] = static_cast<std::ptrdiff_t>(in_frame(box.x + columns_[k], view.columns)) * view.column_stride;
        auto to = light.begin();
        for (const std::ptrdiff_t row : rows_) {
          const T* from = view.at(0, in_frame(box.y + row, view.rows), 0);
          std::size_t k = 0;
          for (const std::size_t end : ends_) {
            const auto count = static_cast<double>(end - k);
            std::conditional_t<std::is_integral_v<T>, std::uint32_t, double> sum = 0;
            for (; k < end; ++k) sum += from[offsets[k]];
            *to++ = static_cast<double>(sum) / count - dark_;
          }
        }
      },
      frame);
  return light;
}

ToneLook::ToneLook(const FreeBox& box, double dark, double frequency)
    : cells_(box, dark, std::max<std::size_t>(static_cast<std::size_t>(1 / (kRowsACycle * frequency)), 1),
             std::max<std::size_t>(static_cast<std::size_t>(std::nearbyint(1 / frequency)), 1)) {
  const auto& rows = cells_.rows();
  const auto half = static_cast<std::ptrdiff_t>(box.height / kHalves), end = static_cast<std::ptrdiff_t>(box.height);
  std::size_t first = 0;
  for (const std::ptrdiff_t bound : {std::ptrdiff_t{0}, half, end, rows.back() + 1}) {
    std::size_t last = first;
    while (last < rows.size() && rows[last] < bound) ++last;
    const auto count = static_cast<Eigen::Index>(last - first);
    Eigen::MatrixXd waves(kWaves, count);
    for (Eigen::Index k = 0; k < count; ++k) {
      const double angle =
          2 * std::numbers::pi * frequency * static_cast<double>(rows[first + static_cast<std::size_t>(k)]);
      waves.col(k) << 1, std::cos(angle), std::sin(angle);
    }
    const EigenFactors factors = symmetric_factors(gram(waves));
    const Eigen::VectorXd inverse =
        (factors.values.array() > kSingular * factors.values.maxCoeff()).select(factors.values.array().inverse(), 0.0);
    const Eigen::MatrixXd spread = product(factors.vectors * inverse.asDiagonal(), factors.vectors.transpose());
    const Eigen::MatrixXd weights = product(spread, waves);
    Part part{first, last - first, {}, {}};
    part.waves.assign(waves.data(), waves.data() + waves.size());
    for (Eigen::Index k = 0; k < weights.rows(); ++k)
      for (Eigen::Index row = 0; row < count; ++row) part.weights.push_back(weights(k, row));
    if (parts_.size() == 1 || parts_.size() == 2)
      spread_ = std::max(spread_, std::sqrt(energy_of({part.weights.data(), part.rows})));
    parts_.push_back(std::move(part));
    first = last;
  }
}

LightLook ToneLook::look(const AnyFramesView& frame, const FreeBox& box) const {
  const std::size_t cells = cells_.cells(), inner = cells - 2;
  std::vector<double> light = cells_.light(frame, box);
  std::vector<double> found(parts_.size() * kWaves * cells);  // (parts × waves × cells)
  const auto wave = [&](std::size_t part, std::size_t k) { return found.data() + (part * kWaves + k) * cells; };
  for (std::size_t p = 0; p < parts_.size(); ++p) {
    const Part& part = parts_[p];
    for (std::size_t row = 0; row < part.rows; ++row) {
      const double* of_row = light.data() + (part.first + row) * cells;
      for (std::size_t k = 0; k < kWaves; ++k) {
        const double weight = part.weights[k * part.rows + row];
        for (std::size_t cell = 0; cell < cells; ++cell) wave(p, k)[cell] += weight * of_row[cell];
      }
    }
  }
  const auto swing = [&](std::size_t part, std::size_t cell) {
    return std::complex<double>(wave(part, 1)[cell], -wave(part, 2)[cell]);
  };
  LightLook result;
  std::array<std::complex<double>, 4> sides{};  // left, right, above, below
  for (std::size_t half = 1; half <= kHalves; ++half) {
    sides[0] += swing(half, 0) / static_cast<double>(kHalves);
    sides[1] += swing(half, cells - 1) / static_cast<double>(kHalves);
    for (std::size_t cell = 1; cell <= inner; ++cell) {
      result.mean.push_back(wave(half, 0)[cell]);
      result.swing.push_back(swing(half, cell));
    }
  }
  for (std::size_t cell = 1; cell <= inner; ++cell) {
    sides[2] += swing(0, cell) / static_cast<double>(inner);
    sides[3] += swing(parts_.size() - 1, cell) / static_cast<double>(inner);
  }
  for (const auto& side : sides) result.beside.push_back(std::abs(side));

  std::vector<double> rest(cells_.rows().size() * inner);
  for (std::size_t p = 0; p < parts_.size(); ++p)
    for (std::size_t row = 0; row < parts_[p].rows; ++row) {
      const double* waves = parts_[p].waves.data() + row * kWaves;
      const double* of_row = light.data() + (parts_[p].first + row) * cells + 1;
      double* to = rest.data() + (parts_[p].first + row) * inner;
      for (std::size_t cell = 0; cell < inner; ++cell)
        to[cell] = of_row[cell] - (waves[0] * wave(p, 0)[cell + 1] + waves[1] * wave(p, 1)[cell + 1] +
                                   waves[2] * wave(p, 2)[cell + 1]);
    }
  result.noise = spread_ * row_noise(rest, inner);
  return result;
}

WaveformLook::WaveformLook(const FreeBox& box, double dark) : cells_(box, dark) {
  const auto rows = static_cast<Eigen::Index>(box.height);
  Eigen::MatrixXd trend(rows, static_cast<Eigen::Index>(kTrend + 1));
  for (Eigen::Index row = 0; row < rows; ++row) {
    std::array<double, kTrend + 1> values;
    legendre(2.0 * static_cast<double>(row) / static_cast<double>(std::max<Eigen::Index>(rows - 1, 1)) - 1, values);
    for (std::size_t k = 0; k < values.size(); ++k) trend(row, static_cast<Eigen::Index>(k)) = values[k];
  }
  const Eigen::MatrixXd basis = pivoted_orthogonal_factors(trend).basis;
  terms_ = static_cast<std::size_t>(basis.cols());
  for (Eigen::Index row = 0; row < rows; ++row)
    for (Eigen::Index k = 0; k < basis.cols(); ++k) slow_.push_back(basis(row, k));
}

LightLook WaveformLook::look(const AnyFramesView& frame, const FreeBox& box) const {
  const std::size_t rows = cells_.rows().size(), cells = cells_.cells(), inner = cells - 2;
  std::vector<double> light = cells_.light(frame, box);
  LightLook result;
  result.mean.resize(inner);
  std::vector<double> trend(terms_ * cells);
  for (std::size_t row = 0; row < rows; ++row)
    for (std::size_t cell = 0; cell < cells; ++cell) {
      const double value = light[row * cells + cell];
      if (cell > 0 && cell <= inner) result.mean[cell - 1] += value / static_cast<double>(rows);
      for (std::size_t k = 0; k < terms_; ++k) trend[k * cells + cell] += slow_[row * terms_ + k] * value;
    }
  result.waveform.resize(rows);
  double whole = 0;  // energy of the cells' swing
  for (std::size_t row = 0; row < rows; ++row)
    for (std::size_t cell = 0; cell < cells; ++cell) {
      double& value = light[row * cells + cell];
      for (std::size_t k = 0; k < terms_; ++k) value -= slow_[row * terms_ + k] * trend[k * cells + cell];
      if (cell == 0 || cell > inner) continue;
      result.waveform[row] += value / static_cast<double>(inner);
      whole += value * value;
    }
  const double energy = energy_of(result.waveform);
  std::vector<double> follow(cells, 1.0);
  if (!(energy > 0)) {
    result.beside.assign(2, 0.0);
    result.common = 0;
    result.follow.assign(inner, 1.0);
    return result;
  }
  for (std::size_t cell = 0; cell < cells; ++cell) {
    double sum = 0;
    for (std::size_t row = 0; row < rows; ++row) sum += light[row * cells + cell] * result.waveform[row];
    follow[cell] = sum / energy;
  }
  std::vector<double> rest(rows * inner);
  for (std::size_t row = 0; row < rows; ++row)
    for (std::size_t cell = 0; cell < inner; ++cell)
      rest[row * inner + cell] = light[row * cells + cell + 1] - result.waveform[row] * follow[cell + 1];
  result.noise = row_noise(rest, inner) / std::sqrt(static_cast<double>(rows));
  result.beside = {follow.front(), follow.back()};
  result.common = static_cast<double>(inner) * energy / whole;
  result.follow.assign(follow.begin() + 1, follow.end() - 1);

  std::vector<double> padded(kPadded * rows);
  std::ranges::copy(result.waveform, padded.begin());
  const auto spectrum = half_spectra(padded, padded.size());
  std::size_t strongest = kLowest;
  for (std::size_t k = kLowest; k + kPadded < spectrum.size(); ++k)
    if (std::norm(spectrum[k]) > std::norm(spectrum[strongest])) strongest = k;
  result.frequency = static_cast<double>(strongest) / static_cast<double>(padded.size());
  return result;
}

}  // namespace ocisac
