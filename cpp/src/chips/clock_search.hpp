// Clocks compared by the whole frame, where the one that was followed step by step may have slipped a chip.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "chips/channel_turn.hpp"

namespace ocisac {

// Half the distance of the closest pair of sequences over the channel's noise.
double closeness(const ChannelEstimate& channel, std::size_t frame_rows);
inline constexpr double kCloseSequences = 6;  // below it chips are easily taken for others

// Clocks followed over ever more rows, from some rows on, as many side by side as are likely; the channel of that which
// leaves least of the frame. Absent where none gets so far.
std::optional<RefinedChannel> follow_side_by_side(const TurnContext& context, std::vector<ChannelEstimate> clocks,
                                                  RowRange rows);

// What is grown step by step may have slipped a chip and be plausible all the same, where the start's clock is not sure
// at the frame's ends and chips are easily taken for others. There clocks near the start are followed side by side, and
// what leaves least of the frame is taken instead of `found`.
std::optional<RefinedChannel> likelier(const TurnContext& context, const ChannelEstimate& start,
                                       std::optional<RefinedChannel> found);

}  // namespace ocisac
