#include "chips/edges.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/check_interrupt.hpp"
#include "core/levels.hpp"

namespace ocisac {

namespace {

constexpr double kSmallSwing = 0.3;       // min size of a swing relative to those around it
constexpr std::size_t kSwingsAround = 6;  // before, and equally many after

// Median of values weighted by themselves.
double weighted_median(std::span<double> values) {
  std::ranges::sort(values);
  double total = 0;
  for (double value : values) total += value;
  double sum = 0;
  for (double value : values)
    if ((sum += value) >= 0.5 * total) return value;
  return values.back();
}

std::vector<double> swings_between(std::span<const double> signal, std::span<const std::size_t> points) {
  std::vector<double> swings;
  for (std::size_t k = 1; k < points.size(); ++k) swings.push_back(std::abs(signal[points[k]] - signal[points[k - 1]]));
  return swings;
}

// True if a swing is small relative to those around it and not larger than its neighbours. At an end, where only the
// outer point can be removed, it must be smaller than its one neighbour: of equal swings the inner one is removed,
// which preserves the level.
bool is_small(std::span<const double> swings, std::size_t k) {
  const std::size_t final = swings.size() - 1;
  const bool at_end = k == 0 || k == final;
  const double min_neighbour = std::min(swings[k == 0 ? 1 : k - 1], swings[k == final ? final - 1 : k + 1]);
  if (at_end ? swings[k] >= min_neighbour : swings[k] > min_neighbour) return false;
  const std::size_t first = k < kSwingsAround ? 0 : k - kSwingsAround;
  const std::size_t last = std::min(k + kSwingsAround + 1, swings.size());
  std::array<double, 2 * kSwingsAround + 1> around{};
  std::ranges::copy(swings.subspan(first, last - first), around.begin());
  return swings[k] < kSmallSwing * weighted_median(std::span(around).first(last - first));
}

}  // namespace

std::vector<std::size_t> turning_points(std::span<const double> signal, double hysteresis) {
  std::vector<std::size_t> points{0};
  const auto add = [&](std::size_t n) {
    if (n != points.back()) points.push_back(n);
  };
  std::size_t low = 0, high = 0;
  int direction = 0;  // 1: rising, next point is a maximum
  for (std::size_t n = 0; n < signal.size(); ++n) {
    if (signal[n] > signal[high]) high = n;
    if (signal[n] < signal[low]) low = n;
    if (direction >= 0 && signal[high] - signal[n] > hysteresis) {
      add(high);
      direction = -1;
      low = high = n;
    } else if (direction <= 0 && signal[n] - signal[low] > hysteresis) {
      add(low);
      direction = 1;
      low = high = n;
    }
  }
  add(direction > 0 ? high : low);
  return points;
}

std::vector<std::size_t> prune_turning_points(std::span<const double> signal, std::vector<std::size_t> points) {
  while (points.size() > 2) {
    check_interrupt();
    const auto swings = swings_between(signal, points);
    std::vector<std::uint8_t> gone(points.size(), 0);
    bool any = false;
    for (std::size_t k = 0; k < swings.size(); ++k) {
      if (gone[k] || gone[k + 1] || !is_small(swings, k)) continue;
      any = true;
      if (k + 1 < swings.size() || k == 0)
        gone[k] = 1;  // inside the frame both ends are removed, so maxima and minima alternate
      if (k > 0) gone[k + 1] = 1;
    }
    if (!any) break;
    std::size_t kept = 0;
    for (std::size_t k = 0; k < points.size(); ++k)
      if (!gone[k]) points[kept++] = points[k];
    points.resize(kept);
  }
  return points;
}

void Edges::add(std::span<const double> signal, std::size_t from, std::size_t to, double level) {
  const bool up = signal[to] > signal[from];
  const auto passed = [&](std::size_t n) { return (signal[n] > level) == up; };
  const auto place = [&](std::size_t n) {
    return static_cast<double>(n) - 1 + (level - signal[n - 1]) / (signal[n] - signal[n - 1]);
  };
  std::size_t first = from + 1, last = to;
  while (first < to && !passed(first)) ++first;
  while (last > first && passed(last - 1)) --last;
  rows.push_back(0.5 * (place(first) + place(last)));
  rising.push_back(up);
  for (const std::size_t n : {first - 1, first}) {
    const double share = (signal[n] - signal[from]) / (signal[to] - signal[from]);
    roundings += share < kSmallShare || share > 1 - kSmallShare ? 0.5 : 0.0;
  }
}

double Edges::rounding() const { return roundings / static_cast<double>(std::max<std::size_t>(rows.size(), 1)); }

Edges edges_between(std::span<const double> signal, std::span<const std::size_t> points, double share,
                    std::size_t around) {
  Edges edges;
  for (std::size_t k = 1; k < points.size(); ++k) {
    const std::size_t from = points[k - 1], to = points[k];
    const auto [darker, brighter] = std::minmax(signal[from], signal[to]);
    double low = darker, high = brighter;
    for (std::size_t i = k - 1 - std::min(k - 1, around); i < std::min(k + 1 + around, points.size()); ++i) {
      low = std::min(low, signal[points[i]]);
      high = std::max(high, signal[points[i]]);
    }
    double level = low + share * (high - low);
    if (level <= darker || level >= brighter) level = darker + share * (brighter - darker);
    edges.add(signal, from, to, level);
  }
  return edges;
}

}  // namespace ocisac
