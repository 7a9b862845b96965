#include "lights/light_regions.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <tuple>
#include <utility>
#include <variant>

#include "columns/moving_mean.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_combination.hpp"

namespace ocisac {

namespace {

constexpr int kMaxCuts = 4;              // recursion depth
constexpr double kMaxRows = 0.9;         // of a box; lights with more rows get the whole box
constexpr std::size_t kMinRows = 64;     // of a light
constexpr std::size_t kReach = 14;       // rows to either side for the local mean of a swing
constexpr double kActive = 0.06;         // relative to the strongest swing
constexpr double kAboveNoise = 4;        // standard deviations of a mean over a window
constexpr std::size_t kMinDarkRows = 8;  // between two lights

struct Run {
  std::size_t begin, end;
};

// Root mean square of the rows' swings about their moving mean, over windows, with the noise subtracted.
std::vector<double> activity(const CombinedColumn& column) {
  const auto slow = moving_mean(column.signal, kReach);
  std::vector<double> squares(column.signal.size());
  for (std::size_t n = 0; n < squares.size(); ++n) squares[n] = std::pow(column.signal[n] - slow[n], 2);
  auto active = moving_mean(squares, kReach / 2);
  const double noise = std::isfinite(column.noise) ? column.noise * column.noise : 0.0;
  const double chance = 1 + kAboveNoise * std::sqrt(2.0 / kReach);
  for (double& value : active) value = std::sqrt(std::max(value - chance * noise, 0.0));
  return active;
}

// Runs of rows with swings, separated by at least kMinDarkRows rows without.
std::vector<Run> active_runs(const CombinedColumn& column) {
  const auto active = activity(column);
  const double lowest = kActive * *std::ranges::max_element(active);
  std::vector<Run> runs;
  if (!(lowest > 0)) return runs;
  for (std::size_t n = 0; n < active.size(); ++n) {
    if (active[n] <= lowest) continue;
    if (!runs.empty() && n - runs.back().end < kMinDarkRows)
      runs.back().end = n + 1;
    else
      runs.push_back({n, n + 1});
  }
  std::erase_if(runs, [](const Run& run) { return run.end - run.begin < kMinRows; });
  return runs;
}

// From the first to the last column of a light.
Run extent(const std::vector<std::uint8_t>& columns) {
  const auto first = std::ranges::find_if(columns, [](auto has) { return has != 0; });
  const auto last = std::find_if(columns.rbegin(), columns.rend(), [](auto has) { return has != 0; });
  return {static_cast<std::size_t>(first - columns.begin()), static_cast<std::size_t>(columns.rend() - last)};
}

Region first_to_last_swing(const AnyFramesView& frame, const Region& region, const ToneCurve& curve) {
  const auto runs = active_runs(combine_columns(part_of(frame, region), 0, curve));
  if (runs.empty()) return region;
  const std::size_t begin = runs.front().begin, end = runs.back().end;
  return {region.x, region.y + begin, region.width, end - begin};
}

class Cutter {
 public:
  Cutter(const AnyFramesView& frame, const ToneCurve& curve, std::size_t most)
      : frame_(frame), curve_(curve), most_(most) {}

  // Cuts by columns, then by rows, until nothing is cut. Dark chips of the strongest light are no end of the others.
  void cut(const Region& region, int depth) {
    if (regions_.size() == most_) return;
    const auto parts = depth < kMaxCuts ? parts_of(region) : std::vector<Region>{};
    if (parts.size() < 2) {
      regions_.push_back(swinging_rows(frame_, region, curve_));
      return;
    }
    for (const Region& part : parts) cut(part, depth + 1);
  }

  [[nodiscard]] std::vector<Region> regions() && { return std::move(regions_); }

 private:
  [[nodiscard]] std::vector<Region> parts_of(const Region& region) const {
    const auto view = part_of(frame_, region);
    std::vector<Region> parts;
    for (const auto& light : light_groups(view, 0, curve_)) {
      const Run columns = extent(light.columns);
      const Region part{region.x + columns.begin, region.y, columns.end - columns.begin, region.height};
      parts.push_back(first_to_last_swing(frame_, part, curve_));
    }
    if (parts.size() > 1) return parts;
    parts.clear();
    for (const auto& run : active_runs(combine_columns(view, 0, curve_)))
      parts.push_back({region.x, region.y + run.begin, region.width, run.end - run.begin});
    return parts;
  }

  const AnyFramesView& frame_;
  const ToneCurve& curve_;
  std::size_t most_;
  std::vector<Region> regions_;
};

}  // namespace

Region swinging_rows(const AnyFramesView& frame, const Region& region, const ToneCurve& curve) {
  const Region swinging = first_to_last_swing(frame, region, curve);
  const bool most = static_cast<double>(swinging.height) > kMaxRows * static_cast<double>(region.height);
  return most ? region : swinging;
}

std::vector<Region> light_regions(const AnyFramesView& frame, const ToneCurve& curve, std::size_t most) {
  const Shape shape = shape_of(frame);
  const Region whole{0, 0, shape.columns, shape.rows};
  if (shape.rows < 2 * kMinRows) return {whole};
  Cutter cutter(frame, curve, most);
  cutter.cut(whole, 0);
  auto regions = std::move(cutter).regions();
  std::ranges::sort(regions, {}, [](const Region& region) { return std::tuple(region.x, region.y); });
  return regions;
}

}  // namespace ocisac
