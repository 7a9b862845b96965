// Compares clocks over the whole frame, where step-by-step tracking may have slipped a chip.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "chips/channel_iteration.hpp"

namespace ocisac {

// Half the distance of the closest pair of sequences over the channel's noise.
double closeness(const ChannelEstimate& channel, std::size_t frame_rows);
inline constexpr double kCloseSequences = 6;  // below this, chips are easily confused

// Tracks clocks in parallel over a growing range of rows, as many as are likely; returns the channel with the smallest
// residual over the frame. Absent if no clock reaches it.
std::optional<RefinedChannel> track_in_parallel(const IterationContext& context, std::vector<ChannelEstimate> clocks,
                                                RowRange rows);

// Step-by-step growth may slip a chip and still seem plausible if the start's clock is uncertain at the frame's ends
// and chips are easily confused. In that case clocks near the start are tracked in parallel, and the one with the
// smallest residual over the frame replaces `found`.
std::optional<RefinedChannel> resolve_slip(const IterationContext& context, const ChannelEstimate& start,
                                           std::optional<RefinedChannel> found);

}  // namespace ocisac
