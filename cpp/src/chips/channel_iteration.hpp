// One iteration of channel refinement: detects the chips of some rows and fits the channel to them.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/refine_channel.hpp"

namespace ocisac {

// Data shared by all iterations of a frame.
struct IterationContext {
  std::span<const double> signal;
  const DetectChips& detect;
  const RefineOptions& options;

  [[nodiscard]] RowRange frame() const { return {0, signal.size()}; }
  [[nodiscard]] bool is_used_up() const { return options.effort != nullptr && !(options.effort->rows > 0); }
  // True if the remaining effort allows detection of the rows' chips and `fits` fits of levels.
  [[nodiscard]] bool may_try(RowRange range, const ChipClock& clock, double fits) const;
};

struct FoundChips {
  std::vector<double> levels;
  std::ptrdiff_t first = 0;
  [[nodiscard]] KnownChips known() const { return {levels, first}; }
  [[nodiscard]] bool operator==(const FoundChips& other) const = default;
};

struct Iteration {
  ChannelEstimate channel;
  FoundChips chips;
};

// Absent if the effort is used up, or the chips do not determine a channel of positive swing.
std::optional<Iteration> iterate(const IterationContext& context, const ChannelEstimate& channel, RowRange range);

// The best of several iterations by residual: where the clock is uncertain at the ends of the rows, also with a higher
// and a lower rate; where the exposure is uncertain, also with a longer and a shorter one.
std::optional<Iteration> iterate_best(const IterationContext& context, const ChannelEstimate& channel, RowRange range);

// All chips that affect the rows; known chips of the options replace detected ones.
std::optional<FoundChips> detect_rows(const IterationContext& context, const ChannelEstimate& channel, RowRange range);

inline constexpr double kMovedErrors = 1.5, kMaxMove = 0.4;  // of a clock at the rows' ends: standard errors, chips

// Removes the chips at the ends, which affect only a few rows.
FoundChips without_edges(const FoundChips& chips);

// Standard error of the clock at the farther end of the rows, chips.
double end_error(const ChannelEstimate& channel, RowRange range);

// The clock with a rate that moves the ends of the rows by `chips`, if they lie about the chips of the fit.
ChannelEstimate with_rate_moved(ChannelEstimate channel, RowRange range, double chips);

// The clock with a longer or shorter exposure.
ChannelEstimate with_exposure_moved(ChannelEstimate channel, double chips);

}  // namespace ocisac
