// Test that a channel explains all parts of a frame equally well; a lost clock raises the residual of a part.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "chips/channel_iteration.hpp"

namespace ocisac {

// Root mean square of the channel's residual over windows with half overlap, and of its component that changes from row
// to row like noise.
struct ResidualWindow {
  RowRange rows;
  double left, as_noise;
};

// `left`: (rows) the residual.
std::vector<ResidualWindow> residual_windows(std::span<const double> left, const ChannelEstimate& channel);

// A clock lost in a part of the frame raises the residual there. So does higher noise (of brighter light, for example).
// If chips or exposures are several rows long, wrong chips give a residual that changes slowly from row to row, unlike
// noise.
bool is_even(std::span<const ResidualWindow> windows, const ChipClock& clock);

// Channel of the part of the frame with the smallest residual, for a restart.
std::optional<ChannelEstimate> channel_of_best_part(const IterationContext& context, const RefinedChannel& found,
                                                    std::span<const ResidualWindow> windows);

}  // namespace ocisac
