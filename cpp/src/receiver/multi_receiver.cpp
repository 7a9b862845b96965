#include "ocisac/receiver/multi_receiver.hpp"

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kLookAgain = 60;  // frames, while all lights are received
constexpr std::size_t kLookSoon = 8;    // while one is not
constexpr double kSamePlace = 0.5;
constexpr std::size_t kFramesAgreed = 3;
constexpr std::size_t kGivenUp = 90;  // frames in which a light was not received

double share_of_smaller(const Region& a, const Region& b) {
  const std::size_t smaller = std::min(a.width * a.height, b.width * b.height);
  return static_cast<double>(shared_pixels(a, b)) / static_cast<double>(std::max<std::size_t>(smaller, 1));
}

double share_of_larger(const Region& a, const Region& b) {
  return static_cast<double>(shared_pixels(a, b)) /
         static_cast<double>(std::max(a.width * a.height, b.width * b.height));
}

Region hull(const Region& a, const Region& b) {
  const std::size_t x = std::min(a.x, b.x), y = std::min(a.y, b.y);
  return {x, y, std::max(a.x + a.width, b.x + b.width) - x, std::max(a.y + a.height, b.y + b.height) - y};
}

}  // namespace

MultiReceiver::MultiReceiver(const Camera& camera, MultiReceiverOptions options)
    : camera_(camera), options_(std::move(options)) {
  require(options_.max_sources >= 1, "max_sources", options_.max_sources, "1 or above");
  const Receiver checked(camera_, options_.receiver);  // arguments are refused here
  for (const Region& region : options_.regions) {
    require(region.width > 0 && region.height > 0, "regions",
            std::to_string(region.width) + " x " + std::to_string(region.height), "boxes that are not empty");
    add(region);
  }
}

void MultiReceiver::add(const Region& region) {
  sources_.push_back({next_number_++, region, Receiver(camera_, options_.receiver)});
}

bool MultiReceiver::must_look() const {
  if (!options_.regions.empty()) return false;
  const bool all_well = std::ranges::all_of(sources_, [](const Source& source) { return source.lost == 0; });
  return sources_.empty() || agreed_ > 0 || since_look_ >= (all_well ? kLookAgain : kLookSoon);
}

// A gap between lights is one that frames agree on; long runs of a light lie elsewhere in the next one.
void MultiReceiver::look(std::span<const AnyFramesView> colours, const Region& whole) {
  since_look_ = 0;
  const auto colour = best_column(colours, camera_.tone_curve).second;
  auto found = light_regions(colours[colour], camera_.tone_curve);
  const bool agrees =
      found.size() == proposed_.size() && std::ranges::equal(found, proposed_, [](const Region& a, const Region& b) {
        return share_of_larger(a, b) > kSamePlace;
      });
  agreed_ = agrees ? agreed_ + 1 : 1;
  if (agrees)
    std::ranges::transform(found, proposed_, proposed_.begin(), hull);
  else
    proposed_ = std::move(found);
  if (proposed_.size() == 1 && proposed_.front() == whole) {
    agreed_ = 0;
    if (sources_.empty()) add(whole);
  } else if (agreed_ >= kFramesAgreed) {
    agreed_ = 0;
    adopt(proposed_);
  }
}

// Lights that were not there join; those that are received keep their place.
void MultiReceiver::adopt(const std::vector<Region>& found) {
  std::erase_if(sources_, [&](const Source& source) {
    const auto within = [&](const Region& region) { return share_of_smaller(source.region, region) > kSamePlace; };
    return source.lost >= kGivenUp || std::ranges::count_if(found, within) > 1;  // what was taken for one is several
  });
  auto largest_first = found;
  std::ranges::stable_sort(largest_first, std::ranges::greater{}, [](const Region& r) { return r.width * r.height; });
  for (const Region& region : largest_first) {
    const auto is_same = [&](const Source& source) { return share_of_smaller(source.region, region) > kSamePlace; };
    if (sources_.size() < options_.max_sources && std::ranges::none_of(sources_, is_same)) add(region);
  }
}

std::vector<SourceFrame> MultiReceiver::push(std::span<const AnyFramesView> colours,
                                             std::optional<std::int64_t> frame) {
  const std::int64_t number = frame.value_or(order_.next());
  const auto lengths = lengths_of(colours);
  const Region whole{0, 0, lengths[2], lengths[1]};
  const bool fits =
      std::ranges::all_of(options_.regions, [&](const Region& region) { return is_inside(region, lengths[2], lengths[1]); });
  require(fits || began_, "regions", "one outside the frame",
          "boxes inside " + std::to_string(lengths[2]) + " x " + std::to_string(lengths[1]) + " pixels");
  began_ = true;
  const auto verdict = order_.admit(number, lengths);
  auto outcome = verdict.outcome;
  if (outcome == FrameOutcome::received && !fits) outcome = FrameOutcome::other_shape;
  if (outcome == FrameOutcome::received && !are_numbers(colours)) outcome = FrameOutcome::not_finite;
  if (outcome != FrameOutcome::received) {
    ReceivedFrame left_out = nothing_received(number);
    left_out.outcome = outcome;
    left_out.missing = verdict.missing;
    return {{0, whole, std::move(left_out)}};
  }
  if (verdict.anew) std::erase_if(sources_, [&](const Source&) { return options_.regions.empty(); });
  ++since_look_;
  if (must_look()) look(colours, whole);

  std::vector<SourceFrame> results;
  for (Source& source : sources_) {
    std::vector<AnyFramesView> parts;
    for (const auto& colour : colours) parts.push_back(part_of(colour, source.region));
    auto received = source.receiver.push(parts, number, source.region.y);
    const bool well = received.outcome == FrameOutcome::received;
    source.lost = well ? 0 : source.lost + 1;
    results.push_back({source.number, source.region, std::move(received)});
  }
  if (results.empty()) {  // not sure yet how many
    results.push_back({0, whole, nothing_received(number)});
    results.front().received.outcome = FrameOutcome::unsearched;
  }
  std::ranges::stable_sort(results, std::ranges::greater{}, [](const SourceFrame& result) {
    return result.received.outcome == FrameOutcome::received ? result.received.snr
                                                             : -std::numeric_limits<double>::infinity();
  });
  return results;
}

}  // namespace ocisac
