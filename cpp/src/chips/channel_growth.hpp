// Channel of a frame from that of a part of its rows: steps of refine_channel and find_channel.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/refine_channel.hpp"

namespace ocisac {

// Exposures that are tried where none is known, of up to `longest` chips, in rows.
std::vector<double> exposures_up_to(double longest, double rows_per_chip);

// Rates that are tried within a relative tolerance: one is right within `slack` chips at either end of so many chips.
std::vector<double> rates_within(double rows_per_chip, double tolerance, double chips, double slack);

// Data shared by all iterations of a frame.
struct IterationContext {
  std::span<const double> signal;
  const DetectChips& detect;
  const RefineOptions& options;

  [[nodiscard]] bool is_used_up() const { return options.effort != nullptr && !(options.effort->rows > 0); }
  // True if the remaining effort allows detection of the rows' chips and `fits` fits of levels.
  [[nodiscard]] bool may_try(RowRange range, const ChipClock& clock, double fits) const;
};

struct FoundChips {
  std::vector<double> levels;
  std::ptrdiff_t first = 0;
  [[nodiscard]] KnownChips known() const { return {levels, first}; }
  // Without those at the ends, which affect only a few rows.
  [[nodiscard]] KnownChips inner() const;
};

// Detects the chips of some rows and fits the channel to them. Absent if the effort is used up, or the chips do not
// determine a channel of positive swing.
std::optional<RefinedChannel> iterate(const IterationContext& context, const ChannelEstimate& channel, RowRange range);

// All chips that affect the rows; known chips of the options replace detected ones.
std::optional<FoundChips> detect_rows(const IterationContext& context, const ChannelEstimate& channel, RowRange range);

// Extends the rows by at least a factor in each round, further while the clock is certain; if the clock was lost in a
// part of the frame, restarts from the best part with smaller steps.
std::optional<RefinedChannel> grow_to_frame(const IterationContext& context, const ChannelEstimate& start);

// Root mean square of the channel's residual over windows with half overlap, and of its component that changes from row
// to row like noise.
struct ResidualWindow {
  RowRange rows;
  double left, as_noise;
};

// `left`: (rows) the residual.
std::vector<ResidualWindow> residual_windows(std::span<const double> left, const ChannelEstimate& channel);

// True if a channel explains all parts of a frame equally well. A clock lost in a part raises the residual there. So
// does higher noise (of brighter light, for example). If chips or exposures are several rows long, wrong chips give a
// residual that changes slowly from row to row, unlike noise.
bool is_even(std::span<const ResidualWindow> windows, const ChipClock& clock);

// Half the distance of the closest pair of sequences over the channel's noise.
double closeness(const ChannelEstimate& channel, std::size_t frame_rows);
inline constexpr double kCloseSequences = 6;  // below this, chips are easily confused

inline constexpr std::size_t kMaxClocks = 8;  // followed in parallel

// Tracks clocks in parallel over a growing range of rows, as many as are likely; returns the channel with the smallest
// residual over the frame. Absent if no clock reaches it.
std::optional<RefinedChannel> track_in_parallel(const IterationContext& context, std::vector<ChannelEstimate> clocks,
                                                RowRange rows);

}  // namespace ocisac
