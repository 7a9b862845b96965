// Extends a channel that is valid in a part of a frame to the whole frame.
#pragma once

#include <optional>

#include "chips/channel_iteration.hpp"

namespace ocisac {

// Extends by at least this factor per round (1.3: by 30 %), further only while the clock is certain.
std::optional<RefinedChannel> grow(const IterationContext& context, const ChannelEstimate& start, double min_growth);

// The same; if the clock was lost in a part of the frame, restarts from the best part with smaller steps.
std::optional<RefinedChannel> grow_to_frame(const IterationContext& context, const ChannelEstimate& start);

}  // namespace ocisac
