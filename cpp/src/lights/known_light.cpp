#include "ocisac/lights/known_light.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numeric>
#include <variant>
#include <vector>

#include "core/linear_algebra.hpp"
#include "lights/box_gain.hpp"
#include "lights/light_pattern.hpp"
#include "ocisac/camera/linear_light.hpp"

namespace ocisac {

namespace {

constexpr double kMoved = 0.15;              // change of a cell's mean that movement makes, relative to the amplitude
constexpr double kDeviations = 4;            // standard errors
constexpr double kLeast = 0.7, kMost = 1.4;  // ratio of amplitudes, and of means, of a light that stays the same
constexpr double kTurned = 0.5;              // rad between the halves of a box: another frequency
constexpr std::size_t kAcross = 32, kDown = 16;  // steps of the gradient in a box: a quarter of a cell, an eighth
constexpr int kSteps = 6;                        // to the place of a light
constexpr double kPlaces = 32;                   // in a box: a smaller distance is no movement
constexpr double kFlat = 0.03;                   // ratio of pivots: means change along one direction only

double sum_of(std::span<const double> values) { return std::accumulate(values.begin(), values.end(), 0.0); }

double product_of(std::span<const double> a, std::span<const double> b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

// Ratio of two amplitudes or means if a light may stay the same between them; else absent.
std::optional<double> ratio(double now, double then) {
  if (!(then > 0 && kLeast < now / then && now / then < kMost)) return std::nullopt;
  return now / then;
}

// The cells' means keep their ratios.
bool means_stay(const LightPattern& now, const LightPattern& then, double amplitude) {
  const auto brighter = ratio(sum_of(now.mean), sum_of(then.mean));
  if (!brighter) return false;
  const double allowed = std::max(kMoved * amplitude, kDeviations * std::hypot(now.noise, then.noise));
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
  if (!swing || std::abs(turned) > kTurned || !means_stay(now, then, amplitude)) return std::nullopt;
  return swing;
}

std::optional<double> swing_of_waveform(const LightPattern& now, const LightPattern& then) {
  const double before = std::sqrt(product_of(then.waveform, then.waveform));
  const auto swing = ratio(std::sqrt(product_of(now.waveform, now.waveform)), before);
  const double amplitude = std::sqrt(2.0 / static_cast<double>(then.waveform.size())) * before;
  if (!swing || !means_stay(now, then, amplitude)) return std::nullopt;
  return swing;
}

Region region_of(const FreeBox& box) {
  return {static_cast<std::size_t>(box.x), static_cast<std::size_t>(box.y), box.width, box.height};
}

bool is_within(const FreeBox& box, const Shape& shape) {
  return box.x >= 0 && box.y >= 0 && is_inside(region_of(box), shape.columns, shape.rows);
}

// Change of the cells' means by a step of the box to the right and by one down; none of data, which changes them too.
using Gradient = std::array<std::vector<double>, 2>;

Gradient gradient_of(const TonePattern& view, const AnyFramesView& frame, const FreeBox& box) {
  const Shape shape = shape_of(frame);
  Gradient slopes;
  for (const std::size_t axis : {0U, 1U}) {
    const std::size_t step = std::max<std::size_t>(axis == 0 ? box.width / kAcross : box.height / kDown, 1);
    const auto moved = [&](std::ptrdiff_t by) {
      FreeBox end = box;
      (axis == 0 ? end.x : end.y) += by;
      return is_within(end, shape) ? end : box;
    };
    const FreeBox first = moved(-static_cast<std::ptrdiff_t>(step)), last = moved(static_cast<std::ptrdiff_t>(step));
    const auto way = static_cast<double>(std::max<std::ptrdiff_t>(last.x - first.x + last.y - first.y, 1));
    const LightPattern before = view.pattern_in(frame, first);
    slopes[axis] = view.pattern_in(frame, last).mean;
    for (std::size_t k = 0; k < before.mean.size(); ++k) slopes[axis][k] = (slopes[axis][k] - before.mean[k]) / way;
  }
  return slopes;
}

}  // namespace

struct KnownLight::State {
  Camera camera;
  Shape shape;
  FreeBox box;
  std::variant<TonePattern, WaveformPattern> view;
  LightPattern pattern;
  Gradient gradient;
  MeasuredLight first;

  [[nodiscard]] LightPattern pattern_at(const AnyFramesView& frame, const FreeBox& place) const {
    return std::visit([&](const auto& known) { return known.pattern_in(frame, place); }, view);
  }

  [[nodiscard]] bool is_tone() const { return std::holds_alternative<TonePattern>(view); }

  // Columns and rows by which the light lies right of and below the box, by least squares of the cells' means.
  [[nodiscard]] Place shift(const LightPattern& now) const {
    const auto& [right, down] = gradient;
    const double light = sum_of(now.mean), before = sum_of(pattern.mean);
    if (right.empty() || !(light > 0 && before > 0)) return {0, 0};
    std::vector<double> change(now.mean.size());
    for (std::size_t k = 0; k < change.size(); ++k) change[k] = pattern.mean[k] - now.mean[k] * (before / light);
    Eigen::MatrixXd slopes(static_cast<Eigen::Index>(change.size()), 2);
    slopes << Eigen::Map<const Eigen::VectorXd>(right.data(), slopes.rows()),
        Eigen::Map<const Eigen::VectorXd>(down.data(), slopes.rows());
    const Eigen::MatrixXd way =
        least_squares(slopes, Eigen::Map<const Eigen::VectorXd>(change.data(), slopes.rows()), kFlat);
    const auto step = [](double distance, std::size_t size) {
      const bool still = std::abs(distance) < std::max(static_cast<double>(size) / kPlaces, 1.0);
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

  [[nodiscard]] std::optional<MeasuredLight> found_near(const AnyFramesView& frame, FreeBox place) const {
    for (int k = 0; k < kSteps; ++k) {
      if (!is_within(place, shape)) return std::nullopt;
      const LightPattern now = pattern_at(frame, place);
      const auto [right, down] = shift(now);
      if (right == 0 && down == 0) {
        const auto swing = is_tone() ? swing_of_tone(now, pattern) : swing_of_waveform(now, pattern);
        if (!swing) return std::nullopt;
        const double frequency = now.frequency ? *now.frequency / camera.row_time : first.frequency;
        return measured(frame, region_of(place), frequency, *swing);
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
  const FreeBox place{static_cast<std::ptrdiff_t>(box.x), static_cast<std::ptrdiff_t>(box.y), box.width, box.height};
  const double dark = camera.tone_curve.dark_level;
  using View = std::variant<TonePattern, WaveformPattern>;
  State state{
      camera,
      shape,
      place,
      carries_data ? View(WaveformPattern(place, dark)) : View(TonePattern(place, dark, frequency * camera.row_time)),
      {},
      {},
      {}};
  state.pattern = state.pattern_at(frame, place);
  if (const auto* tone = std::get_if<TonePattern>(&state.view)) state.gradient = gradient_of(*tone, frame, place);
  state.first = state.measured(frame, box, frequency, 1);
  state_ = std::make_shared<const State>(std::move(state));
}

const MeasuredLight& KnownLight::first() const { return state_->first; }

std::optional<MeasuredLight> KnownLight::find(const AnyFramesView& frame, std::span<const Place> places) const {
  const Shape shape = shape_of(frame);
  if (shape.rows != state_->shape.rows || shape.columns != state_->shape.columns) return std::nullopt;
  for (const Place& place : places) {
    const FreeBox box{place.x, place.y, state_->box.width, state_->box.height};
    const auto found = state_->found_near(frame, box);
    if (found) return found->mean > 0 && state_->first.mean > 0 ? found : std::nullopt;
  }
  return std::nullopt;
}

}  // namespace ocisac
