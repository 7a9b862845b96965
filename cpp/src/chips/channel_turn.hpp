// A turn of refining a channel: the chips of some rows detected with it, and the channel fitted to them.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/refine_channel.hpp"

namespace ocisac {

// What all turns of a frame share.
struct TurnContext {
  std::span<const double> signal;
  const DetectChips& detect;
  const RefineOptions& options;

  [[nodiscard]] RowRange frame() const { return {0, signal.size()}; }
  [[nodiscard]] bool is_used_up() const { return options.effort != nullptr && !(options.effort->rows > 0); }
  // Whether there is effort left to detect the rows' chips and to fit levels `fits` times.
  [[nodiscard]] bool may_try(RowRange range, const ChipClock& clock, double fits) const;
};

struct FoundChips {
  std::vector<double> levels;
  std::ptrdiff_t first = 0;
  [[nodiscard]] KnownChips known() const { return {levels, first}; }
  [[nodiscard]] bool operator==(const FoundChips& other) const = default;
};

struct Turn {
  ChannelEstimate channel;
  FoundChips chips;
};

// Absent where there is no effort left, or the chips do not determine a channel of positive swing.
std::optional<Turn> take_turn(const TurnContext& context, const ChannelEstimate& channel, RowRange range);

// A turn; where the clock is not sure at the ends of the rows, also from a higher and a lower rate, and where the
// exposure is not sure either, from a longer and a shorter one: the one that leaves least.
std::optional<Turn> take_best_turn(const TurnContext& context, const ChannelEstimate& channel, RowRange range);

// All chips that the rows see; those of the options' known ones as they are known.
std::optional<FoundChips> detect_rows(const TurnContext& context, const ChannelEstimate& channel, RowRange range);

// Edge chips are seen by a few rows only: those do not count.
FoundChips without_edges(const FoundChips& chips);

std::ptrdiff_t chip_at(double row, const ChipClock& clock);

// Standard error of the clock at the farther end of the rows, chips.
double end_error(const ChannelEstimate& channel, RowRange range);

// The clock with a rate that moves the ends of the rows by `chips`, if they lie about the chips that told it.
ChannelEstimate with_rate_moved(ChannelEstimate channel, RowRange range, double chips);

// The clock with a longer or shorter exposure.
ChannelEstimate with_exposure_moved(ChannelEstimate channel, double chips);

}  // namespace ocisac
