// A channel that is right in a part of a frame, followed to the whole frame.
#pragma once

#include <optional>

#include "chips/channel_turn.hpp"

namespace ocisac {

// Outwards by at least so much from one round to the next (1.3: by 30 %), only as far at a time as the clock is sure.
std::optional<RefinedChannel> grow(const TurnContext& context, const ChannelEstimate& start, double min_growth);

// The same; where the clock was lost in a part of the frame, again from the best part in smaller steps.
std::optional<RefinedChannel> grow_to_frame(const TurnContext& context, const ChannelEstimate& start);

}  // namespace ocisac
