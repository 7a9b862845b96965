#include "lights/light_pattern.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <type_traits>
#include <variant>

#include "core/linear_algebra.hpp"
#include "ocisac/rows/basis.hpp"
#include "ocisac/rows/tone_search.hpp"
#include "rows/fit.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kCells = 8, kHalves = 2;
constexpr std::size_t kSampled = 64;  // columns of a box
constexpr double kRowsACycle = 16;    // of a tone
constexpr std::size_t kWaves = 3;     // 1, cosine, sine
constexpr std::size_t kTrend = 3;     // degree of the slow light beside a waveform

std::size_t ceil_of(std::size_t value, std::size_t step) { return (value + step - 1) / step; }

// Evenly spaced positions from 0 on.
std::vector<std::ptrdiff_t> positions(std::size_t count, std::size_t step) {
  std::vector<std::ptrdiff_t> at(count);
  for (std::size_t k = 0; k < count; ++k) at[k] = static_cast<std::ptrdiff_t>(k * step);
  return at;
}

std::size_t in_frame(std::ptrdiff_t at, std::size_t length) {
  return static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(at, 0, static_cast<std::ptrdiff_t>(length) - 1));
}

// Standard deviation of a row from the differences of following rows, which texture larger than a row hardly enters.
// `rest`: (rows × cells). Harmonics that the fit leaves count as noise, unlike in second differences.
double row_noise(std::span<const double> rest, std::size_t cells) {
  double energy = 0;
  for (std::size_t k = cells; k < rest.size(); ++k) energy += (rest[k] - rest[k - cells]) * (rest[k] - rest[k - cells]);
  const auto count = rest.size() > cells ? static_cast<double>(rest.size() - cells) : 1.0;
  return std::sqrt(0.5 * energy / count);
}

RowSampling sampling_at(std::span<const std::ptrdiff_t> rows) { return {.times = {rows.begin(), rows.end()}}; }

}  // namespace

LightCells::LightCells(const FreeBox& box, double dark, std::size_t row_step) : dark_(dark) {
  const std::size_t step = ceil_of(box.width, kSampled);
  columns_ = positions(ceil_of(box.width, step), step);
  const std::size_t cells = std::clamp<std::size_t>(columns_.size() / 2, 1, kCells);
  for (std::size_t cell = 1; cell <= cells; ++cell) ends_.push_back(ceil_of(cell * columns_.size(), cells));
  rows_ = positions(ceil_of(box.height, row_step), row_step);
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

TonePattern::TonePattern(const FreeBox& box, double dark, double frequency)
    : cells_(box, dark, std::max<std::size_t>(static_cast<std::size_t>(1 / (kRowsACycle * frequency)), 1)) {
  const auto& rows = cells_.rows();
  std::size_t first = 0;
  for (std::size_t half = 1; half <= kHalves; ++half) {
    const auto bound = static_cast<std::ptrdiff_t>(half * box.height / kHalves);
    const auto end = static_cast<std::size_t>(std::lower_bound(rows.begin(), rows.end(), bound) - rows.begin());
    const Eigen::MatrixXd waves =
        tone_design(sampling_at(std::span(rows).subspan(first, end - first)), {&frequency, 1});
    parts_.push_back({first, waves, linear_fit(waves, kWaves).weights});
    spread_ = std::max(spread_, parts_.back().weights.col(0).norm());
    first = end;
  }
}

std::vector<double> TonePattern::fit(const std::vector<double>& light) const {
  const std::size_t cells = cells_.cells();
  std::vector<double> fitted(parts_.size() * kWaves * cells);
  double* to = fitted.data();
  for (const Rows& part : parts_) {
    const double* row = light.data() + part.first * cells;
    for (Eigen::Index n = 0; n < part.weights.rows(); ++n, row += cells)
      for (std::size_t k = 0; k < kWaves; ++k)
        for (std::size_t cell = 0; cell < cells; ++cell)
          to[k * cells + cell] += part.weights(n, static_cast<Eigen::Index>(k)) * row[cell];
    to += kWaves * cells;
  }
  return fitted;
}

// Standard error of a cell's mean, from what the fit leaves.
double TonePattern::noise(const std::vector<double>& light, const std::vector<double>& fitted) const {
  const std::size_t cells = cells_.cells();
  std::vector<double> rest;
  rest.reserve(light.size());
  const double* of_part = fitted.data();
  for (const Rows& part : parts_) {
    const double* row = light.data() + part.first * cells;
    for (Eigen::Index n = 0; n < part.waves.rows(); ++n, row += cells)
      for (std::size_t cell = 0; cell < cells; ++cell)
        rest.push_back(row[cell] - (of_part[cell] + part.waves(n, 1) * of_part[cells + cell] +
                                    part.waves(n, 2) * of_part[2 * cells + cell]));
    of_part += kWaves * cells;
  }
  return spread_ * row_noise(rest, cells);
}

LightPattern TonePattern::pattern_in(const AnyFramesView& frame, const FreeBox& box) const {
  const std::size_t cells = cells_.cells();
  const std::vector<double> light = cells_.light(frame, box), fitted = fit(light);
  LightPattern result;
  for (std::size_t half = 0; half < kHalves; ++half)
    for (std::size_t cell = 0; cell < cells; ++cell) {
      const double* wave = &fitted[half * kWaves * cells + cell];
      result.mean.push_back(wave[0]);
      result.swing.emplace_back(wave[cells], -wave[2 * cells]);
    }
  result.noise = noise(light, fitted);
  return result;
}

WaveformPattern::WaveformPattern(const FreeBox& box, double dark)
    : cells_(box, dark), slow_(linear_fit(tone_design(centred_rows(box.height), {}, kTrend), 0).basis) {}

LightPattern WaveformPattern::pattern_in(const AnyFramesView& frame, const FreeBox& box) const {
  using Light = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const std::vector<double> pixels = cells_.light(frame, box);
  const auto rows = static_cast<Eigen::Index>(cells_.rows().size());
  const Eigen::MatrixXd light = Eigen::Map<const Light>(pixels.data(), rows, static_cast<Eigen::Index>(cells_.cells()));
  const Eigen::MatrixXd fast = light - product(slow_, transposed_product(slow_, light));
  const Eigen::VectorXd waveform = fast.rowwise().mean();
  const Eigen::RowVectorXd mean = light.colwise().mean();
  const double energy = waveform.squaredNorm();
  LightPattern result;
  result.mean.assign(mean.begin(), mean.end());
  result.waveform.assign(waveform.begin(), waveform.end());
  if (!(energy > 0)) return result;
  const Light rest = fast - waveform * (transposed_product(fast, waveform) / energy).transpose();
  result.noise = row_noise({rest.data(), static_cast<std::size_t>(rest.size())}, cells_.cells()) /
                 std::sqrt(static_cast<double>(rows));
  const std::size_t count = result.waveform.size();
  result.frequency = strongest_tone(result.waveform, count, 2 / static_cast<double>(count), 0.5).frequency;
  return result;
}

}  // namespace ocisac
