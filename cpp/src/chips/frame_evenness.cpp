#include "chips/frame_evenness.hpp"

#include <algorithm>
#include <cmath>

namespace ocisac {

namespace {

constexpr double kEven = 1.15, kEvenErrors = 6;  // ratio of the residuals of two parts of the frame; standard errors
constexpr double kSmoothRows = 4;
constexpr double kWindowChips = 30;  // length of a part, beside the exposure

}  // namespace

std::vector<ResidualWindow> residual_windows(std::span<const double> left, const ChannelEstimate& channel) {
  const double length = kWindowChips * channel.clock.rows_per_chip + channel.clock.exposure_rows;
  std::vector<ResidualWindow> windows;
  const std::size_t size = std::min(static_cast<std::size_t>(length), channel.rows.size());
  for (std::size_t begin = channel.rows.begin; begin + size <= channel.rows.end;
       begin += std::max<std::size_t>(size / 2, 1)) {
    double squares = 0, changes = 0;
    for (std::size_t n = begin; n < begin + size; ++n) {
      squares += left[n] * left[n];
      if (n > begin) changes += 0.5 * (left[n] - left[n - 1]) * (left[n] - left[n - 1]);
    }
    const auto count = static_cast<double>(size);
    windows.push_back(
        {{begin, begin + size}, std::sqrt(squares / count), std::sqrt(changes / std::max(count - 1, 1.0))});
  }
  return windows;
}

bool is_even(std::span<const ResidualWindow> windows, const ChipClock& clock) {
  if (windows.empty()) return true;
  const double lowest = std::ranges::min_element(windows, {}, &ResidualWindow::left)->left;
  const bool tells_noise = std::max(clock.exposure_rows, clock.rows_per_chip) >= kSmoothRows;
  return std::ranges::all_of(windows, [&](const ResidualWindow& window) {
    const double by_chance = kEvenErrors / std::sqrt(2 * static_cast<double>(window.rows.size()));
    return window.left <= (kEven + by_chance) * std::max(lowest, tells_noise ? window.as_noise : 0.0);
  });
}

std::optional<ChannelEstimate> channel_of_best_part(const IterationContext& context, const RefinedChannel& found,
                                                    std::span<const ResidualWindow> windows) {
  const ChipClock& clock = found.channel.clock;
  const RowRange rows = std::ranges::min_element(windows, {}, &ResidualWindow::left)->rows;
  const double half = 0.5 * clock.exposure_rows;
  const std::ptrdiff_t first = std::max(chip_at(static_cast<double>(rows.begin) - half, clock), found.first);
  const std::ptrdiff_t last = std::min(chip_at(static_cast<double>(rows.end) + half, clock),
                                       found.first + static_cast<std::ptrdiff_t>(found.chips.size()) - 1);
  if (last <= first) return std::nullopt;
  const std::span<const double> part(found.chips.data() + (first - found.first),
                                     static_cast<std::size_t>(last - first + 1));
  return fit_channel(context.signal, {part, first}, clock, {1, 0, context.options.exposure_known});
}

}  // namespace ocisac
