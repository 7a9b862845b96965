#include "ocisac/lights/known_light.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdint>
#include <numeric>
#include <type_traits>
#include <variant>
#include <vector>

#include "core/levels.hpp"
#include "core/linear_algebra.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/rows/basis.hpp"
#include "ocisac/rows/tone_search.hpp"
#include "ocisac/tones/tone_gain.hpp"
#include "rows/fit.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kCells = 8;
constexpr std::size_t kSampled = 64;  // columns of a box, steps of its gradient; a smaller distance is no movement
constexpr double kRowsACycle = 16;    // of a tone
constexpr std::size_t kTrend = 3;     // degree of the slow light beside a waveform
constexpr double kMost = 1.4;         // ratio of amplitudes, and of means, of a light that stays the same

double sum_of(std::span<const double> values) { return std::accumulate(values.begin(), values.end(), 0.0); }

std::size_t ceil_of(std::size_t value, std::size_t step) { return (value + step - 1) / step; }

std::ptrdiff_t in_frame(std::ptrdiff_t at, std::size_t length) {
  return std::clamp<std::ptrdiff_t>(at, 0, static_cast<std::ptrdiff_t>(length) - 1);
}

// How a light's box looks in a frame: cells of 2 × 8, or 1 × 8 of data.
struct LightPattern {
  std::vector<double> mean;                 // light of the cells, DN
  double noise = 0;                         // standard error of a cell's mean, DN: harmonics and data count as noise
  std::vector<std::complex<double>> swing;  // of the cells' tone, the upper half of the box first
  std::vector<double> waveform;             // (rows,) of all cells, where the light sends data
};

// Patterns of a box, possibly outside of the frame, whose edge counts there: tones by least squares in each half, or
// the waveform that all cells have in common beside slow light.
class PatternFinder {
 public:
  // `frequency`: cycles per row of a tone.
  PatternFinder(const Region& box, double dark, std::optional<double> frequency) : dark_(dark) {
    const std::size_t step = ceil_of(box.width, kSampled), halves = frequency ? 2 : 1;
    for (std::size_t column = 0; column < box.width; column += step) columns_.push_back(column);
    const std::size_t cells = std::clamp<std::size_t>(columns_.size() / 2, 1, kCells);
    for (std::size_t cell = 1; cell <= cells; ++cell) ends_.push_back(ceil_of(cell * columns_.size(), cells));
    const auto every = frequency ? static_cast<std::size_t>(1 / (kRowsACycle * *frequency)) : 0;
    for (std::size_t half = 0, row = 0; half < halves; ++half) {
      RowSampling sampling{};
      for (; row < (half + 1) * box.height / halves; row += std::max<std::size_t>(every, 1)) {
        rows_.push_back(row);
        sampling.times.push_back(static_cast<double>(row));
      }
      const std::size_t tones = frequency ? 1 : 0;
      const Eigen::MatrixXd waves = tone_design(sampling, {tones ? &*frequency : nullptr, tones});
      waves_.push_back(waves);
      weights_.push_back(linear_fit(waves, waves.cols()).weights);
    }
    if (!frequency) slow_ = linear_fit(tone_design(centred_rows(box.height), {}, kTrend), 0).basis;
  }

  [[nodiscard]] LightPattern pattern_in(const AnyFramesView& frame, const Place& place) const {
    const auto cells = std::ssize(ends_);
    const std::vector<double> light = light_in(frame, place);
    LightPattern result;
    double energy = 0, spread = 0;  // of changes from row to row beside the tone; of a mean, relative to a row
    for (std::size_t half = 0, row = 0; half < weights_.size(); ++half) {
      const Eigen::MatrixXd &weights = weights_[half], &waves = waves_[half];
      const Eigen::Index rows = weights.rows(), tone = waves.cols() - 1;
      const Eigen::Map<const Eigen::MatrixXd> seen(&light[row * ends_.size()], cells, rows);
      row += static_cast<std::size_t>(rows);
      const Eigen::MatrixXd fitted = product(seen, weights);  // (cells × waves)
      const Eigen::MatrixXd rest = seen - product(fitted.rightCols(tone), waves.rightCols(tone).transpose());
      energy += (rest.rightCols(rows - 1) - rest.leftCols(rows - 1)).squaredNorm();
      spread = std::max(spread, weights.col(0).norm());
      for (Eigen::Index cell = 0; cell < cells; ++cell) {
        result.mean.push_back(fitted(cell, 0));
        if (tone > 0) result.swing.emplace_back(fitted(cell, 1), -fitted(cell, 2));
      }
    }
    result.noise = spread * std::sqrt(0.5 * energy / static_cast<double>(light.size()));
    if (slow_.size() == 0) return result;
    Eigen::VectorXd means(slow_.rows());
    for (std::size_t n = 0; n < rows_.size(); ++n)
      means[static_cast<Eigen::Index>(n)] = mean_of(std::span(light).subspan(n * ends_.size(), ends_.size()));
    const Eigen::VectorXd waveform = beside(slow_, means);
    result.waveform.assign(waveform.begin(), waveform.end());
    return result;
  }

 private:
  // Mean light of the cells: (rows × cells).
  [[nodiscard]] std::vector<double> light_in(const AnyFramesView& frame, const Place& place) const {
    std::vector<double> light(rows_.size() * ends_.size());
    std::visit(
        [&]<class T>(const FramesView<const T>& view) {
          std::vector<std::ptrdiff_t> offsets(columns_.size());
          for (std::size_t k = 0; k < offsets.size(); ++k)
            offsets[k] =
                in_frame(place.x + static_cast<std::ptrdiff_t>(columns_[k]), view.columns) * view.column_stride;
          auto to = light.begin();
          for (const std::size_t row : rows_) {
            const auto at = in_frame(place.y + static_cast<std::ptrdiff_t>(row), view.rows);
            const T* from = view.at(0, static_cast<std::size_t>(at), 0);
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

  double dark_;
  std::vector<std::size_t> rows_, columns_;       // taken, of the box
  std::vector<std::size_t> ends_;                 // of the cells, in columns_
  std::vector<Eigen::MatrixXd> waves_, weights_;  // of each half, (rows × waves)
  Eigen::MatrixXd slow_;                          // (rows × terms), orthonormal; empty of a tone
};

// Ratio of two amplitudes or means if a light may stay the same between them; else absent.
std::optional<double> ratio(double now, double then) {
  if (!(then > 0 && 1 / kMost < now / then && now / then < kMost)) return std::nullopt;
  return now / then;
}

// The cells' means keep their ratios.
bool means_stay(const LightPattern& now, const LightPattern& then, double amplitude) {
  const auto brighter = ratio(sum_of(now.mean), sum_of(then.mean));
  if (!brighter) return false;
  const double allowed = std::max(kSmallShare * amplitude, kSure * std::hypot(now.noise, then.noise));
  return std::ranges::equal(now.mean, then.mean,
                            [&](double mean, double before) { return std::abs(mean / *brighter - before) <= allowed; });
}

// Amplitude relative to that of the reference; absent if it is not the same light.
std::optional<double> swing_of_tone(const LightPattern& now, const LightPattern& then) {
  const auto half = [](const LightPattern& pattern, std::size_t which) {
    const auto cells = static_cast<std::ptrdiff_t>(pattern.swing.size() / 2);
    const auto begin = pattern.swing.begin() + static_cast<std::ptrdiff_t>(which) * cells;
    return std::accumulate(begin, begin + cells, std::complex<double>());
  };
  const auto upper = half(now, 0), lower = half(now, 1), above = half(then, 0), below = half(then, 1);
  const double turned = std::arg(lower * std::conj(upper) * std::conj(below) * above);
  const auto swing = ratio(std::abs(upper + lower), std::abs(above + below));
  double energy = 0;
  for (const auto& cell : then.swing) energy += std::norm(cell);
  const double amplitude = std::sqrt(energy / static_cast<double>(then.swing.size()));
  if (!swing || std::abs(turned) > kMostly || !means_stay(now, then, amplitude)) return std::nullopt;
  return swing;
}

std::optional<double> swing_of_waveform(const LightPattern& now, const LightPattern& then) {
  const double before = std::sqrt(product_at_lag(then.waveform, 0));
  const auto swing = ratio(std::sqrt(product_at_lag(now.waveform, 0)), before);
  const double amplitude = std::sqrt(2.0 / static_cast<double>(then.waveform.size())) * before;
  if (!swing || !means_stay(now, then, amplitude)) return std::nullopt;
  return swing;
}

}  // namespace

MeasuredLight box_gain(const AnyFramesView& frame, const Camera& camera, const Region& box, double frequency) {
  const ToneGain found = tone_gain(part_of(frame, box), camera, {&frequency, 1}, {.pooled = true});
  const double cycles =
      std::fmod(frequency * camera.row_time * static_cast<double>(box.y), 1.0);  // before its first row
  return {.box = box,
          .frequency = frequency,
          .gain = found.gain[0],
          .gain_std = found.gain_std[0],
          .phase = std::remainder(found.phase[0] - kTwoPi * cycles, kTwoPi),
          .mean = found.mean[0],
          .flags = found.flags[0]};
}

struct KnownLight::State {
  Camera camera;
  Shape shape;
  Region box;
  bool carries_data;
  PatternFinder patterns;
  LightPattern pattern{};
  // Change of the cells' means by a step of the box to the right and by one down; none of data, which changes them too.
  std::array<std::vector<double>, 2> gradient{};
  MeasuredLight first{};

  [[nodiscard]] Region box_at(const Place& place) const {
    return {static_cast<std::size_t>(place.x), static_cast<std::size_t>(place.y), box.width, box.height};
  }

  [[nodiscard]] bool is_within(const Place& place) const {
    return place.x >= 0 && place.y >= 0 && is_inside(box_at(place), shape.columns, shape.rows);
  }

  void add_gradient(const AnyFramesView& frame, const Place& place) {
    for (const std::size_t axis : {0U, 1U}) {
      const std::size_t step = std::max<std::size_t>((axis == 0 ? box.width : 2 * box.height) / kSampled, 1);
      const auto moved = [&](std::ptrdiff_t by) {
        Place end = place;
        (axis == 0 ? end.x : end.y) += by;
        return is_within(end) ? end : place;
      };
      const Place first_end = moved(-static_cast<std::ptrdiff_t>(step)),
                  last = moved(static_cast<std::ptrdiff_t>(step));
      const auto way = static_cast<double>(std::max<std::ptrdiff_t>(last.x - first_end.x + last.y - first_end.y, 1));
      const LightPattern before = patterns.pattern_in(frame, first_end);
      gradient[axis] = patterns.pattern_in(frame, last).mean;
      for (std::size_t k = 0; k < before.mean.size(); ++k)
        gradient[axis][k] = (gradient[axis][k] - before.mean[k]) / way;
    }
  }

  // Columns and rows by which the light lies right of and below the box, by least squares of the cells' means.
  [[nodiscard]] Place shift(const LightPattern& now) const {
    const auto& [right, down] = gradient;
    const double light = sum_of(now.mean), before = sum_of(pattern.mean);
    if (right.empty() || !(light > 0 && before > 0)) return {0, 0};
    std::vector<double> change(now.mean.size());
    for (std::size_t k = 0; k < change.size(); ++k) change[k] = pattern.mean[k] - now.mean[k] * (before / light);
    Eigen::MatrixXd slopes(static_cast<Eigen::Index>(change.size()), 2);
    slopes << vector_of(right), vector_of(down);
    const Eigen::MatrixXd way = least_squares(slopes, vector_of(change), kNextToNone);
    const auto step = [](double distance, std::size_t size) {
      const bool still = std::abs(distance) < std::max(static_cast<double>(size) / double{kSampled}, 1.0);
      return still ? 0 : static_cast<std::ptrdiff_t>(std::nearbyint(distance));
    };
    return {step(way(0), box.width), step(way(1), box.height)};
  }

  // A frame in which the light is in the box.
  [[nodiscard]] MeasuredLight measured(const AnyFramesView& frame, const Region& region, double frequency,
                                       double swing) const {
    MeasuredLight light = box_gain(frame, camera, region, frequency);
    light.swing = swing;
    return light;
  }

  [[nodiscard]] std::optional<MeasuredLight> found_near(const AnyFramesView& frame, Place place) const {
    for (int k = 0; k < kMaxIterations; ++k) {
      if (!is_within(place)) return std::nullopt;
      const LightPattern now = patterns.pattern_in(frame, place);
      const auto [right, down] = shift(now);
      if (right == 0 && down == 0) {
        const auto swing = carries_data ? swing_of_waveform(now, pattern) : swing_of_tone(now, pattern);
        if (!swing) return std::nullopt;
        const std::size_t rows = now.waveform.size();
        const double frequency =
            carries_data
                ? strongest_tone(now.waveform, rows, 2 / static_cast<double>(rows), 0.5).frequency / camera.row_time
                : first.frequency;
        return measured(frame, box_at(place), frequency, *swing);
      }
      place.x += right;
      place.y += down;
    }
    return std::nullopt;
  }
};

KnownLight::KnownLight(const AnyFramesView& frame, const Camera& camera, const Region& box, double frequency,
                       bool carries_data) {
  const Shape shape = shape_of(frame);
  require_inside("box", box, shape.columns, shape.rows);
  const Place place{static_cast<std::ptrdiff_t>(box.x), static_cast<std::ptrdiff_t>(box.y)};
  const auto tone = carries_data ? std::nullopt : std::optional(frequency * camera.row_time);
  State state{camera, shape, box, carries_data, PatternFinder(box, camera.tone_curve.dark_level, tone)};
  state.pattern = state.patterns.pattern_in(frame, place);
  if (tone) state.add_gradient(frame, place);
  state.first = state.measured(frame, box, frequency, 1);
  state_ = std::make_shared<const State>(std::move(state));
}

const MeasuredLight& KnownLight::first() const { return state_->first; }

std::optional<MeasuredLight> KnownLight::find(const AnyFramesView& frame, std::span<const Place> places) const {
  const Shape shape = shape_of(frame);
  if (shape.rows != state_->shape.rows || shape.columns != state_->shape.columns) return std::nullopt;
  for (const Place& place : places) {
    const auto found = state_->found_near(frame, place);
    if (found) return found->mean > 0 && state_->first.mean > 0 ? found : std::nullopt;
  }
  return std::nullopt;
}

}  // namespace ocisac
