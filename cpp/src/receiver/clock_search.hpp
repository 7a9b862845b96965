// Clocks compared by the whole frame, where the one that was followed step by step may have slipped a chip.
#pragma once

#include <cstddef>
#include <optional>

#include "channel_turn.hpp"

namespace ocisac {

// Whether the clock may slip a chip unseen: not sure at the frame's ends, and chips easily taken for others.
bool may_slip(const ChannelEstimate& start, std::size_t rows);

// Of a start whose clock is not sure at the frame's ends, the clock near it whose chips of the whole frame leave least.
// What is grown step by step may have slipped a chip and be plausible all the same.
std::optional<ChannelEstimate> likeliest_clock(const TurnContext& context, const ChannelEstimate& start);

}  // namespace ocisac
