#include "ocisac/chips/refine_channel.hpp"

#include <utility>

#include "chips/channel_growth.hpp"
#include "chips/clock_search.hpp"

namespace ocisac {

std::optional<RefinedChannel> refine_channel(std::span<const double> signal, const ChannelEstimate& start,
                                             const DetectChips& detect, const RefineOptions& options) {
  const IterationContext context{signal, detect, options};
  auto grown = grow_to_frame(context, start);
  return options.warped ? grown : resolve_slip(context, start, std::move(grown));
}

}  // namespace ocisac
