#include "ocisac/chips/refine_channel.hpp"

#include "chips/channel_growth.hpp"
#include "chips/clock_search.hpp"

namespace ocisac {

std::optional<RefinedChannel> refine_channel(std::span<const double> signal, const ChannelEstimate& start,
                                             const DetectChips& detect, const RefineOptions& options) {
  const IterationContext context{signal, detect, options};
  return resolve_slip(context, start, grow_to_frame(context, start));
}

}  // namespace ocisac
