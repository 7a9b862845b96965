#include "ocisac/lights/picture_overview.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <type_traits>
#include <variant>

#include "lights/light_patch.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kStep = 4, kSummed = 8;  // every fourth column, in groups of eight
constexpr std::size_t kTile = 32;              // rows
constexpr std::size_t kWide = 8;               // groups
constexpr std::size_t kSkipped = 4;            // rows: an estimate of the noise needs some
constexpr double kClear = 8;                   // energy of a change over that of the noise
constexpr double kSteps = 1.5;    // DN² of integers: a light of amplitude 1 appears, the least that a search detects;
                                  // compression makes 1
constexpr double kBeside = 0.25;  // of the size of a light, around it

template <class T>
void reduce(const FramesView<const T>& view, std::size_t summed, std::size_t groups, std::vector<float>& light) {
  const float scale = 1 / static_cast<float>(summed);
  const std::ptrdiff_t step = view.column_stride * static_cast<std::ptrdiff_t>(kStep);
  const auto of_group = [&](const T* sample, std::ptrdiff_t stride) {
    using Sum = std::conditional_t<std::is_integral_v<T>, std::uint32_t, float>;
    Sum sum = 0;
    for (std::size_t k = 0; k < summed; ++k) sum += static_cast<Sum>(sample[static_cast<std::ptrdiff_t>(k) * stride]);
    return static_cast<float>(sum) * scale;
  };
  float* to = light.data();
  for (std::size_t row = 0; row < view.rows; ++row)
    for (std::size_t group = 0; group < groups; ++group) {
      const T* first = view.at(0, row, group * summed * kStep);
      *to++ = view.column_stride == 1 ? of_group(first, kStep) : of_group(first, step);
    }
}

// Sets what belongs to a light to 0.
void leave_out(const Region& light, std::size_t groups, std::vector<float>& change) {
  constexpr std::size_t kGroup = kStep * kSummed;
  const auto rim = [](std::size_t size) {
    return static_cast<std::size_t>(std::nearbyint(kBeside * static_cast<double>(size))) + kTile;
  };
  const std::size_t rows = change.size() / groups, x = rim(light.width), y = rim(light.height);
  const std::size_t first = (light.x - std::min(light.x, x)) / kGroup;
  const std::size_t last = std::min((light.x + light.width + x) / kGroup + 1, groups);
  for (std::size_t row = light.y - std::min(light.y, y); row < std::min(light.y + light.height + y, rows); ++row)
    for (std::size_t group = first; group < last; ++group) change[row * groups + group] = 0;
}

}  // namespace

PictureOverview::PictureOverview(const AnyFramesView& frame) {
  std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        const std::size_t sampled = (view.columns + kStep - 1) / kStep, summed = std::min(kSummed, sampled);
        require(summed > 0, "frame", view.columns, "columns");
        rows_ = view.rows;
        groups_ = sampled / summed;
        least_ = std::is_integral_v<T> ? kSteps : 0.0;
        light_.resize(rows_ * groups_);
        reduce(view, summed, groups_, light_);
      },
      frame);
}

bool PictureOverview::has_changed(const PictureOverview& now, std::span<const Region> lights) const {
  require(now.rows_ == rows_ && now.groups_ == groups_, "frame", now.rows_, "the shape of the first");
  std::vector<float> change(light_.size());
  for (std::size_t i = 0; i < change.size(); ++i) change[i] = now.light_[i] - light_[i];
  const double least = kClear * noise_variance(change.data(), rows_, groups_, groups_, kSkipped) + least_;
  for (const Region& light : lights) leave_out(light, groups_, change);
  std::vector<double> tiles(groups_), wide((groups_ + kWide - 1) / kWide);  // energies
  for (std::size_t row = 0; row < rows_ / kTile * kTile; ++row) {
    const float* of_row = change.data() + row * groups_;
    for (std::size_t k = 0; k < wide.size(); ++k) {
      double sum = 0;
      for (std::size_t group = k * kWide; group < std::min((k + 1) * kWide, groups_); ++group) {
        const double value = of_row[group];
        tiles[group] += value * value;
        sum += value;
      }
      wide[k] += sum * sum / (kWide * kWide);
    }
    if ((row + 1) % kTile != 0) continue;
    const auto exceeds = [](double most) { return [most](double energy) { return energy / kTile > most; }; };
    if (std::ranges::any_of(tiles, exceeds(least)) || std::ranges::any_of(wide, exceeds(least / kWide))) return true;
    std::ranges::fill(tiles, 0.0);
    std::ranges::fill(wide, 0.0);
  }
  return false;
}

}  // namespace ocisac
