// Clocks compared by the whole frame, where the one that was followed step by step may have slipped a chip.
#pragma once

#include <cstddef>
#include <optional>

#include "channel_turn.hpp"

namespace ocisac {

// What is grown step by step may have slipped a chip and be plausible all the same, where the start's clock is not sure
// at the frame's ends and chips are easily taken for others. There several clocks near the start are followed side by
// side over ever more rows, as many as are likely, and what leaves least of the frame is taken instead of `found`.
std::optional<RefinedChannel> likelier(const TurnContext& context, const ChannelEstimate& start,
                                       std::optional<RefinedChannel> found);

}  // namespace ocisac
