#include "lights/light_regions.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <tuple>

#include "columns/moving_mean.hpp"
#include "core/levels.hpp"
#include "lights/light_patch.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_combination.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kMinRows = 64;     // of a light
constexpr std::size_t kReach = 14;       // rows to either side for the local mean of a swing
constexpr std::size_t kMinDarkRows = 8;  // between two lights

// Root mean square of the rows' swings about their moving mean, over windows, with the noise subtracted.
std::vector<double> activity(const CombinedColumn& column) {
  const auto slow = moving_mean(column.signal, kReach);
  std::vector<double> squares(column.signal.size());
  for (std::size_t n = 0; n < squares.size(); ++n) squares[n] = std::pow(column.signal[n] - slow[n], 2);
  auto active = moving_mean(squares, kReach / 2);
  const double noise = std::isfinite(column.noise) ? column.noise * column.noise : 0.0;
  const double chance = 1 + kSure * std::sqrt(2.0 / kReach);
  for (double& value : active) value = std::sqrt(std::max(value - chance * noise, 0.0));
  return active;
}

// Runs of at least `shortest` rows with swings, separated by at least kMinDarkRows rows without.
std::vector<IndexRange> active_runs(const CombinedColumn& column, std::size_t shortest = kMinRows) {
  const auto active = activity(column);
  const double lowest = kSmallShare * *std::ranges::max_element(active);
  std::vector<IndexRange> runs;
  if (!(lowest > 0)) return runs;
  for (std::size_t n = 0; n < active.size(); ++n) {
    if (active[n] <= lowest) continue;
    if (!runs.empty() && n - runs.back().end < kMinDarkRows)
      runs.back().end = n + 1;
    else
      runs.push_back({n, n + 1});
  }
  std::erase_if(runs, [shortest](const IndexRange& run) { return run.size() < shortest; });
  return runs;
}

// From the first to the last run.
Region hull_of(const std::vector<IndexRange>& runs, const Region& region) {
  if (runs.empty()) return region;
  const std::size_t begin = runs.front().begin, end = runs.back().end;
  return {region.x, region.y + begin, region.width, end - begin};
}

// The same, or the whole region if that is most of it.
Region swinging_part(const std::vector<IndexRange>& runs, const Region& region) {
  const Region swinging = hull_of(runs, region);
  const bool most = static_cast<double>(swinging.height) > (1 - kSmallShare) * static_cast<double>(region.height);
  return most ? region : swinging;
}

ColumnLights lights_in(const AnyFramesView& frame, const Region& region, const ToneCurve& curve) {
  return column_lights(part_of(frame, region), 0, curve);
}

// The columns of each light that has some of its own.
std::vector<Region> parts_by_columns(const Region& region, const std::vector<LightGroup>& groups) {
  std::vector<Region> parts;
  for (const auto& light : groups) {
    const IndexRange columns = extent_of(light.columns);
    parts.push_back({region.x + columns.begin, region.y, columns.size(), region.height});
  }
  return parts;
}

// The parts of one by columns, else by rows; if it is not cut, its part with swings. Dark chips of the strongest light
// are no end of the others.
std::vector<Region> cut(const AnyFramesView& frame, const Region& part, bool is_whole, bool may_cut,
                        const ToneCurve& curve) {
  Region region = part;
  ColumnLights lights = lights_in(frame, region, curve);
  if (!is_whole) {
    region = hull_of(active_runs(lights.combined), region);
    if (region.height < part.height) lights = lights_in(frame, region, curve);
  }
  auto parts = may_cut ? parts_by_columns(region, lights.groups) : std::vector<Region>{};
  if (parts.size() > 1) return parts;
  const auto runs = active_runs(lights.combined);
  if (!may_cut || runs.size() < 2) return {swinging_part(runs, region)};
  parts.clear();
  for (const IndexRange& run : runs) parts.push_back({region.x, region.y + run.begin, region.width, run.size()});
  return parts;
}

}  // namespace

Region swinging_rows(const AnyFramesView& frame, const Region& region, const ToneCurve& curve) {
  return swinging_part(active_runs(lights_in(frame, region, curve).combined, 1), region);
}

std::vector<Region> light_regions(const AnyFramesView& frame, const ToneCurve& curve, std::size_t most) {
  const Shape shape = shape_of(frame);
  const Region whole{0, 0, shape.columns, shape.rows};
  if (shape.rows < 2 * kMinRows) return {whole};
  std::vector<Region> regions;
  std::vector<Region> to_cut{whole};
  for (int cuts = 0; !to_cut.empty(); ++cuts) {
    std::vector<Region> next;
    for (std::size_t k = 0; k < to_cut.size(); ++k) {
      const auto parts = cut(frame, to_cut[k], cuts == 0, cuts < kMaxIterations, curve);
      if (parts.size() == 1)
        regions.push_back(parts.front());
      else
        next.insert(next.end(), parts.begin(), parts.end());
      const std::size_t left = to_cut.size() - 1 - k;
      if (regions.size() + next.size() + left > most) return {};
    }
    to_cut = std::move(next);
  }
  std::ranges::sort(regions, {}, [](const Region& region) { return std::tuple(region.x, region.y); });
  return regions;
}

}  // namespace ocisac
