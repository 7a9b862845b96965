// Whether a channel explains all parts of a frame alike, or lost the clock in one.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "chips/channel_turn.hpp"

namespace ocisac {

// Root mean square of what the channel leaves of the rows it used, over windows, half overlapping; and of what of that
// changes from row to row as noise does.
struct ResidualWindow {
  RowRange rows;
  double left, as_noise;
};

std::vector<ResidualWindow> residual_windows(std::span<const double> signal, const RefinedChannel& found);

// The clock lost in a part of the frame leaves more there than elsewhere. So does more noise (of more light, say);
// where chips or exposures are several rows long, wrong chips leave what hardly changes from row to row, and noise
// does.
bool is_even(std::span<const ResidualWindow> windows, const ChipClock& clock);

// The channel of the part of the frame that is explained best, to begin from again.
std::optional<ChannelEstimate> channel_of_best_part(const TurnContext& context, const RefinedChannel& found,
                                                    std::span<const ResidualWindow> windows);

}  // namespace ocisac
