#include "ocisac/receiver/receiver.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <utility>

#include "core/levels.hpp"
#include "lights/light_regions.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/lights/detect_sources.hpp"

namespace ocisac {

namespace {

constexpr double kFalseLights = 0.1;           // a picture; regions without data are dropped
constexpr std::size_t kSearchedColumns = 640;  // evenly spaced, at most
constexpr std::size_t kMinMargin = 8;          // columns added on either side of a light's region
constexpr std::size_t kRegionsOfLight = 4;     // that a search may propose, for each light that is allowed
constexpr std::size_t kMaxAttempts = 12;       // frames in which a proposal is searched
constexpr std::size_t kGivenUp = 90;           // frames without reception until a light is dropped

// Every `step`-th column.
AnyFramesView thinned(const AnyFramesView& frame, std::size_t step) {
  return std::visit(
      [&](auto view) -> AnyFramesView {
        view.columns = (view.columns + step - 1) / step;
        view.column_stride *= static_cast<std::ptrdiff_t>(step);
        return view;
      },
      frame);
}

std::size_t thinning_of(std::size_t columns) { return (columns + kSearchedColumns - 1) / kSearchedColumns; }

// The strongest light that is no reflection, with a margin on either side and all rows in which its columns swing,
// because a light with data is periodic in some of its rows only.
std::optional<Region> strongest_light(const AnyFramesView& frame, const Camera& camera) {
  const Shape shape = shape_of(frame);
  const std::size_t step = thinning_of(shape.columns);
  for (const LightSource& light :
       detect_sources(thinned(frame, step), camera, {.false_alarms = kFalseLights, .max_sources = 1})) {
    if (light.reflection_of) continue;
    const std::size_t margin = std::max(kMinMargin, light.box.width * step / 4);
    const std::size_t first = light.box.x * step - std::min(light.box.x * step, margin);
    const std::size_t end = std::min(shape.columns, light.box.right() * step + margin);
    const Region rows = swinging_rows(frame, {first, 0, end - first, shape.rows}, camera.tone_curve);
    return hull(rows, {first, light.box.y, end - first, light.box.height});
  }
  return std::nullopt;
}

// Signal-to-noise ratio of the data, or else of the tone.
double strength(const LightFrame& light) {
  const double snr = light.received ? light.received->snr : light.gain ? light.gain->snr : 0.0;
  return std::isfinite(snr) ? snr : -1.0;
}

LightFrame skipped(std::int64_t number, const FrameOrder::Admission& admitted, const Region& whole) {
  LightFrame result{.frame = number, .region = whole, .received = nothing_received(number)};
  result.received->outcome = admitted.outcome;
  result.received->missing = admitted.missing;
  return result;
}

// Boxes of the lights that reflect no other.
std::vector<Region> light_boxes(const AnyFramesView& frame, const Camera& camera) {
  std::vector<Region> boxes;
  for (const LightSource& light : detect_sources(frame, camera))
    if (!light.reflection_of) boxes.push_back(light.box);
  return boxes;
}

// Separate lights; a region that overlaps a larger one is a part of it. Lights with data swing without a common tone.
std::vector<Region> several_lights(const AnyFramesView& frame, const Camera& camera, bool data,
                                   std::size_t max_lights) {
  const std::size_t columns = shape_of(frame).columns, step = thinning_of(columns);
  const AnyFramesView thin = thinned(frame, step);
  auto regions =
      data ? light_regions(thin, camera.tone_curve, kRegionsOfLight * max_lights) : light_boxes(thin, camera);
  for (Region& region : regions) {
    region.x *= step;
    region.width = std::min(region.width * step, columns - region.x);
  }
  std::ranges::stable_sort(regions, std::ranges::greater{}, &Region::pixels);
  std::vector<Region> apart;
  for (const Region& region : regions)
    if (std::ranges::none_of(apart, [&](const Region& r) { return shared_of_smaller(r, region) > kMostly; }))
      apart.push_back(region);
  std::ranges::sort(apart, {}, [](const Region& r) { return std::pair(r.x, r.y); });
  return apart;
}

}  // namespace

Receiver::Receiver(const Camera& camera, ReceiverOptions options) : camera_(camera), options_(std::move(options)) {
  require(options_.max_sources >= 1, "max_sources", options_.max_sources, "1 or above");
  const LightReceiver checked(camera_, options_.light, 0);  // refuses its arguments
  for (const Region& region : options_.regions)
    require(region.width > 0 && region.height > 0, "regions",
            std::to_string(region.width) + " x " + std::to_string(region.height), "boxes that are not empty");
}

void Receiver::add(const Region& region, bool can_move) {
  lights_.emplace_back(camera_, options_.light, next_source_++).place(region, can_move);
}

// A light for each further stream of a lamp's colours, at the lamp's place; all are dropped where no light is seen.
void Receiver::add_streams() {
  if (std::ranges::all_of(lights_, &LightReceiver::is_lost))
    std::erase_if(lights_, std::mem_fn(&LightReceiver::is_other_stream));
  const std::size_t known = lights_.size();
  for (std::size_t k = 0; k < known; ++k)
    for (ColourStream& stream : lights_[k].take_other_streams()) {
      const Region region = lights_[k].region();
      add(region, lights_[k].can_move());
      lights_.back().receive_stream(std::move(stream));
    }
}

// Resets all state of earlier frames.
void Receiver::restart(const Region& whole) {
  proposal_ = {};
  when_lost_.restart();
  further_.restart();
  std::erase_if(lights_, std::mem_fn(&LightReceiver::is_other_stream));
  if (options_.whole_picture && !lights_.empty()) lights_.front().place(whole, false);
  if (options_.whole_picture || !options_.regions.empty())
    for (auto& light : lights_) light.forget();
  else
    lights_.clear();
}

bool Receiver::must_search() const {
  return lights_.empty() || proposal_.agreed > 0 || when_lost_.is_due() ||
         (lights_.size() < options_.max_sources && further_.is_due());
}

// Places lights with given regions, or searches them; true where it searched.
bool Receiver::find(std::span<const AnyFramesView> colours, const Region& whole) {
  further_.pass_frame();
  if (options_.whole_picture || !options_.regions.empty()) {
    if (!lights_.empty()) return false;
    if (options_.whole_picture) add(whole, false);
    for (const Region& region : options_.regions) add(region, false);
    return false;
  }
  if (!must_search()) return false;
  search(colours);
  return true;
}

void Receiver::search(std::span<const AnyFramesView> colours) {
  const std::size_t known = lights_.size();
  const std::size_t colour = colours.size() > 1 ? best_column(colours, camera_.tone_curve).colour : 0;
  if (std::ranges::all_of(lights_, &LightReceiver::is_lost) && proposal_.agreed == 0) {
    if (!lights_.empty()) when_lost_.fail();
    search_one(colours[colour]);
  }
  if (options_.max_sources > 1) search_several(colours[colour]);
  if (known != lights_.size())
    further_.restart();
  else if (proposal_.agreed == 0)
    further_.fail();
}

// Takes effect at once, without agreement over frames: of lights that are all lost, the nearest is placed. Without a
// detected light, all rows with swings are received.
void Receiver::search_one(const AnyFramesView& frame) {
  const Shape shape = shape_of(frame);
  const auto light = strongest_light(frame, camera_);
  const Region region = light.value_or(swinging_rows(frame, {0, 0, shape.columns, shape.rows}, camera_.tone_curve));
  if (lights_.empty())
    add(region, light.has_value());
  else
    std::ranges::max_element(lights_, {}, [&](const LightReceiver& lost) {
      return shared_of_larger(lost.region(), region);
    })->place(region, light.has_value());
}

// Several lights are adopted only if consecutive frames agree on their places: false detections from long runs of one
// light change place between frames.
void Receiver::search_several(const AnyFramesView& frame) {
  auto found = several_lights(frame, camera_, options_.light.data.has_value(), options_.max_sources);
  if (found.size() < 2) {
    proposal_ = {};
    return;
  }
  auto& [regions, agreed, searched] = proposal_;
  const bool agrees = agreed > 0 && std::ranges::equal(found, regions, [](const Region& a, const Region& b) {
                        return shared_of_larger(a, b) > kMostly;
                      });
  agreed = agrees ? agreed + 1 : 1;
  if (agrees)
    std::ranges::transform(found, regions, regions.begin(), hull);
  else
    regions = std::move(found);
  const bool is_sure = agreed >= LightReceiver::kFramesAgreed;
  if (is_sure) adopt(regions);
  if (is_sure || ++searched >= kMaxAttempts) proposal_ = {};
}

// Adds new lights. Received lights keep their region; lost ones get the detected region.
void Receiver::adopt(const std::vector<Region>& found) {
  std::erase_if(lights_, [&](const LightReceiver& light) {
    const auto within = [&](const Region& region) { return shared_of_smaller(light.region(), region) > kMostly; };
    return light.unseen() >= kGivenUp || std::ranges::count_if(found, within) > 1;  // covers several lights
  });
  for (const Region& region : found) {
    const auto same = std::ranges::find_if(
        lights_, [&](const auto& light) { return shared_of_smaller(light.region(), region) > kMostly; });
    if (same == lights_.end()) {
      if (lights_.size() < options_.max_sources) add(region, true);
    } else if (same->unseen() >= LightReceiver::kFramesAgreed) {
      same->place(region, true);
    }
  }
}

// Rows about a region without another light in its columns.
RowRange Receiver::free_rows(const Region& region, std::size_t rows) const {
  RowRange free{0, rows};
  for (const LightReceiver& light : lights_) {
    const Region& other = light.region();
    if (other.x >= region.x + region.width || region.x >= other.x + other.width) continue;
    if (other.y + other.height <= region.y) free.begin = std::max(free.begin, other.y + other.height);
    if (other.y >= region.y + region.height) free.end = std::min(free.end, other.y);
  }
  return free;
}

// A frame that is skipped has another outcome than `received`.
FrameOrder::Admission Receiver::admit(std::span<const AnyFramesView> colours, std::int64_t number,
                                      const Region& whole) {
  const auto outside = std::ranges::find_if_not(
      options_.regions, [&](const Region& region) { return is_inside(region, whole.width, whole.height); });
  const bool fits = outside == options_.regions.end();
  if (!fits && !began_) require_inside("regions", *outside, whole.width, whole.height);
  began_ = true;
  auto admitted = order_.admit(number, {colours.size(), whole.height, whole.width});
  if (admitted.outcome != FrameOutcome::received) return admitted;
  if (!fits)
    admitted.outcome = FrameOutcome::other_shape;
  else if (!are_numbers(colours))
    admitted.outcome = FrameOutcome::not_finite;
  else if (admitted.restarts)
    restart(whole);
  return admitted;
}

std::vector<LightFrame> Receiver::push(std::span<const AnyFramesView> colours, const FrameStamp& stamp) {
  check(stamp, camera_);
  const std::int64_t number = stamp.number.value_or(order_.next());
  const auto lengths = lengths_of(colours);
  const Region whole{0, 0, lengths[2], lengths[1]};
  const auto admitted = admit(colours, number, whole);
  if (admitted.outcome != FrameOutcome::received) return {skipped(number, admitted, whole)};
  const bool searched = find(colours, whole);
  std::vector<LightFrame> results;
  for (LightReceiver& light : lights_) {
    LightColumns seen = light.combine(colours, free_rows(light.region(), whole.height));
    std::optional<ReceivedFrame> received;
    if (ChipReceiver* chips = light.chips()) {
      ChipFrame frame = chips->explain(seen.best, number, seen.rows.begin, seen.region, stamp);
      chips->read(frame);
      chips->place(frame);
      received = chips->decode(std::move(frame));
      received->missing = admitted.missing;
    }
    results.push_back(light.finish(colours, seen, std::move(received), number));
    results.back().searched = searched;
  }
  add_streams();
  if (std::ranges::all_of(lights_, [](const auto& light) { return light.unseen() == 0; }))
    when_lost_.restart();
  else
    when_lost_.pass_frame();
  std::ranges::stable_sort(results, std::ranges::greater{}, strength);
  return results;
}

}  // namespace ocisac
