#include "ocisac/cleaning/stream_cleaner.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <numeric>
#include <utility>

#include "cleaning/block_shares.hpp"
#include "cleaning/cleaned_picture.hpp"
#include "cleaning/merged_blocks.hpp"
#include "cleaning/picture_motion.hpp"
#include "cleaning/slow_tones.hpp"
#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

constexpr std::size_t kFramesOfShares = 8;    // between estimates of the shares, which are the mean of as many
constexpr double kNewPart = 1.0 / 16;         // of the picture, from which on shares are estimated at once
constexpr double kGuideBlocks = 1U << 15U;    // of the picture whose displacement is measured
constexpr std::size_t kMostFrequencies = 64;  // frames whose mean frequency is followed
constexpr std::size_t kFramesOfSearch = 32, kSearchedFrames = 3;  // where none has a light
constexpr double kMostJitter = 0.25;  // of a time stamp, in frames: phases of slow tones are those of whole ones

// Means of the colours over the blocks of their shares.
std::vector<Blocks> in_blocks(const StoredScene& stored, const BlockShares& shares) {
  const std::size_t width = std::max<std::size_t>(1, shares.block_columns / stored.merged());
  std::vector<Blocks> blocks;
  for (const BandedPicture& colour : stored.colours_of(0))
    blocks.push_back(block_means(colour, shares.block_rows, width));
  return blocks;
}

// Blocks of the shares, along each axis, in one of the guide.
std::size_t guide_size(std::size_t blocks) {
  return std::max<std::size_t>(
      1, static_cast<std::size_t>(std::nearbyint(std::sqrt(static_cast<double>(blocks) / kGuideBlocks))));
}

// Logarithm of the cleaned light of blocks, all colours added, in some 32,000 larger blocks.
Blocks guide_of(const std::vector<Blocks>& colours, const ColourLights& lights, std::span<const BlockShares> shares) {
  Blocks picture = colours.front();
  std::fill(picture.light.begin(), picture.light.end(), 0.0);
  std::fill(picture.variance.begin(), picture.variance.end(), 1.0);
  for (std::size_t colour = 0; colour < colours.size(); ++colour) {
    const Values& light = lights.of(colour).light;
    const Values rows = means_of_rows(light, light.size(), shares[colour].block_rows);
    const auto share_of = [&](std::size_t row, std::size_t column) {
      return shares[colour].share[row * picture.columns + column];
    };
    const Values own = without_light(colours[colour].picture(), rows, share_of).light;
    std::ranges::transform(picture.light, own, picture.light.begin(), std::plus{});
  }
  const std::size_t count = guide_size(picture.light.size());
  Blocks guide = block_means(picture.picture(), count, count);
  const double mean = mean_of(guide.light);
  for (double& value : guide.light) value = std::log(std::max(value, 0.0) + kLeastLight * std::max(mean, 1e-300));
  return guide;
}

// Shares, and how many estimates each consists of, moved with the picture, whose places are `size` × `size` blocks;
// what is new has no estimate.
void move(const PictureChange& change, std::size_t size, std::size_t columns, std::vector<BlockShares>& shares,
          Values& estimates) {
  const double down = change.down * static_cast<double>(size), right = change.right * static_cast<double>(size);
  for (BlockShares& own : shares) own.share = moved_picture(own.share, columns, down, right);
  estimates = moved_picture(estimates, columns, down, right);
  for (std::size_t i = 0; i < estimates.size(); ++i)
    if (change.is_new[i / columns / size * blocks_of(columns, size) + i % columns / size] != 0) estimates[i] = 0;
}

// Joined by the shares of this frame.
void estimate(const std::vector<Blocks>& blocks, const ColourLights& lights, std::vector<BlockShares>& shares,
              Values& estimates) {
  for (std::size_t colour = 0; colour < blocks.size(); ++colour) {
    const Values& light = lights.of(colour).light;
    const Values rows = means_of_rows(light, light.size(), shares[colour].block_rows);
    const Values own = light_share(blocks[colour].picture(), rows);
    Values& share = shares[colour].share;
    for (std::size_t i = 0; i < share.size(); ++i)
      share[i] += (own[i] - share[i]) / std::min(estimates[i] + 1, static_cast<double>(kFramesOfShares));
  }
  for (double& count : estimates) count += 1;
}

// True if the shares are estimated in a frame that others have been before.
bool is_due(const Values& estimates, std::size_t frames) {
  const auto missing = std::ranges::count_if(estimates, [](double count) { return count < 0.5; });
  return frames % kFramesOfShares == 0 || frames == 1 ||
         static_cast<double>(missing) > kNewPart * static_cast<double>(estimates.size());
}

}  // namespace

StreamCleaner::StreamCleaner(const Camera& camera, const StreamOptions& options)
    : camera_(camera), options_(options), frame_time_(camera.frame_time) {
  check(camera);
  check_stored(options.noise, options.toe.value_or(0));
  require(options.model != RowModel::given, "model", name_of(options.model), "auto, tone, chips, rows or slow");
}

StreamCleaner::Frame StreamCleaner::push(std::vector<AnyFramesView> colours, std::optional<double> time) {
  require(!colours.empty(), "colours", 0, "at least one");
  if (time) require_finite("time", *time);
  const std::size_t frames = shape_of(colours.front()).frames;
  require(frames == 1, "frame", frames, "one frame");
  if (const auto since = frames_since_last(time))
    leave_room(*since - 1);
  else
    forget_slow();
  const bool is_for_slow = unlit_ < kMostSlowFrames || unlit_ % kFramesOfSearch < kSearchedFrames;
  const bool is_for_all =  // the second of two shows chips
      std::has_single_bit(unlit_) || unlit_ % kFramesOfSearch < 2 || (was_lit_ && unlit_ < kMostSlowFrames);
  if (!is_for_slow && !is_for_all) {
    ++unlit_;
    leave_room(1);
    StoredScene stored(std::move(colours), camera_.tone_curve, options_.noise, 0, false);
    SceneLight light = left_alone(stored, "no light in the frames before; not searched");
    return {std::move(stored), std::move(light)};
  }
  std::optional<Frame> found = followed(colours);
  if (!found) found = slowly(colours);
  if (!found) found = alone(colours, is_for_all ? std::string() : unchanged_);
  await_slow(*found);
  unchanged_ = found->light.unchanged;
  unlit_ = unchanged_.empty() ? 0 : unlit_ + 1;
  was_lit_ = was_lit_ || unlit_ == 0;
  return *std::move(found);
}

StreamCleaner::Frame StreamCleaner::again(const std::vector<AnyFramesView>& colours, std::size_t ago) const {
  require(ago > 0, "ago", ago, "1 or more");
  StoredScene stored(colours, camera_.tone_curve, options_.noise, options_.toe.value_or(0));
  if (!slow_ && !lines_.empty() && before_) {
    SceneLight light = find_scene_light(stored, camera_, options_.model, options_.toe.has_value());
    return {std::move(stored), std::move(light)};
  }
  SceneLight light = left_alone(stored, "no slow light in the frames after it");
  if (slow_ && compares_with(stored.rows()) && !has_equal_rows(stored)) {
    SlowLight own = slow_light_before(stored.colours_of(0), *slow_, static_cast<std::ptrdiff_t>(ago));
    light.unchanged = own.objection;
    if (own.objection.empty()) light = light_of_slow(stored, {std::move(own)});
  }
  return {std::move(stored), std::move(light)};
}

void StreamCleaner::forget() {
  before_.reset();
  forget_slow();
  lines_.clear();
  moving_ = 0;
  unlit_ = 0;
  was_lit_ = false;
  time_.reset();
  frame_time_ = camera_.frame_time;
  frames_ = 0;
}

void StreamCleaner::forget_slow() {
  earlier_ = {};
  slow_.reset();
}

// A whole number, 1 without time stamps; none if those do not tell: time stands still, goes back, begins or ends, or is
// not that of a regular frame.
std::optional<double> StreamCleaner::frames_since_last(std::optional<double> time) {
  const std::optional<double> last = std::exchange(time_, time);
  if (!time && !last) return 1;
  if (!time || !last || !(*time > *last)) return {};
  const double since = *time - *last, frames = std::nearbyint(since / frame_time_.value_or(since));
  const bool is_regular = frames >= 1 && std::abs(since / frame_time_.value_or(since) - frames) <= kMostJitter;
  if (!camera_.frame_time) {  // the mean since the last irregular frame
    frames_ = is_regular ? frames_ + frames : 1;
    frame_time_ = is_regular && frame_time_ ? *frame_time_ + (since - frames * *frame_time_) / frames_ : since;
  }
  return is_regular ? std::optional(frames) : std::nullopt;
}

// Counts missing frames, in which the phases of slow tones advance, and drops courses that are too old.
void StreamCleaner::leave_room(double missing) {
  earlier_.next += static_cast<std::ptrdiff_t>(std::min(missing, static_cast<double>(kMostSlowFrames)));
  std::erase_if(earlier_.courses, [&](const CommonCourse& course) {
    return earlier_.next - course.place >= static_cast<std::ptrdiff_t>(kMostSlowFrames);
  });
}

StreamCleaner::Frame StreamCleaner::alone(const std::vector<AnyFramesView>& colours, const std::string& no_other) {
  StoredScene stored(colours, camera_.tone_curve, options_.noise, options_.toe.value_or(0));
  if (!compares_with(stored.rows())) earlier_ = {};
  SceneLight light =
      find_scene_light(stored, camera_, options_.model, options_.toe.has_value(), {}, earlier_, no_other);
  noise_ = stored.noise();
  if (light.slow.empty()) {
    std::string lines = objection_to_lines(light.lights.front().lights.front());
    if (light.unchanged.empty() && !lines.empty()) light = left_alone(stored, std::move(lines));
  }
  before_.reset();
  if (!light.slow.empty()) {
    keep_slow(light);
    return {std::move(stored), std::move(light)};
  }
  forget_slow();
  if (light.unchanged.empty()) {
    const std::vector<Blocks> blocks = in_blocks(stored, light.shares.front());
    before_ = Before{light.lights.front(),
                     light.shares,
                     guide_of(blocks, light.lights.front(), light.shares),
                     stored.columns(),
                     stored.toe(),
                     light.verdicts.front().slow_bands,
                     0,
                     Values(light.shares.front().share.size(), 1.0)};
  }
  return {std::move(stored), std::move(light)};
}

std::string StreamCleaner::objection_to_lines(const ModelledLight& light) {
  if (light.model == RowModel::rows || options_.model != RowModel::automatic) return {};
  const bool is_tone = light.model == RowModel::tone;
  if (is_tone && std::abs(light.frequency - moving_) < kNextToNone * moving_) return {};
  const std::array frames{std::exchange(lines_, light.light), light.light};
  if (frames[0].size() != lines_.size())
    return is_tone ? "" : "chips that may be lines of the picture: a second frame shows";
  Camera timed = camera_;
  timed.frame_time = frame_time_;
  std::string lines = ocisac::objection_to_lines(frames, light.model, light.frequency, timed);
  if (is_tone && lines.empty()) moving_ = light.frequency;
  if (is_tone && !lines.empty()) lines_ = frames[0];  // a slow advance adds up
  return lines;
}

// One frame shows two slow tones, or shades and a tone, as one tone; the frames after the first ones tell them apart.
void StreamCleaner::await_slow(Frame& first) const {
  if (first.light.slow.empty() || !first.light.unchanged.empty() || was_lit_ || unlit_ + 1 >= kFewFrames) return;
  std::vector<SlowLight> slow = std::move(first.light.slow);
  first.light = left_alone(first.stored, "slow bands of one frame: those after it show");
  first.light.slow = std::move(slow);
}

void StreamCleaner::keep_slow(const SceneLight& light) {
  if (light.slow.back().is_first) earlier_.courses.clear();
  earlier_.courses.push_back(light.slow.back().course);
  earlier_.next = light.slow.back().course.place + 1;
  slow_.reset();
  if (light.unchanged.empty()) slow_ = light.slow.back();
}

bool StreamCleaner::compares_with(std::size_t rows) const {
  return !earlier_.courses.empty() && earlier_.courses.front().modes.size() == mode_count(rows);
}

std::optional<StreamCleaner::Frame> StreamCleaner::slowly(const std::vector<AnyFramesView>& colours) {
  if (!slow_ || !compares_with(shape_of(colours.front()).rows)) return {};
  StoredScene stored(colours, camera_.tone_curve, noise_, options_.toe.value_or(0));
  if (has_equal_rows(stored)) return {};
  const std::vector<std::vector<BandedPicture>> frame{stored.colours_of(0)};
  std::vector<SlowLight> slow = find_slow_lights(frame, earlier_, slow_->common);
  if (!slow.back().objection.empty()) return {};
  SceneLight light = light_of_slow(stored, std::move(slow));
  if (!light.unchanged.empty()) return {};
  keep_slow(light);
  return Frame{std::move(stored), std::move(light)};
}

std::optional<StreamCleaner::Frame> StreamCleaner::followed(const std::vector<AnyFramesView>& colours) {
  const Shape shape = shape_of(colours.front());
  if (!before_ || before_->lights.of_colour.size() != colours.size() || before_->columns != shape.columns ||
      before_->lights.of(0).light.size() != shape.rows)
    return {};
  StoredScene stored(colours, camera_.tone_curve, noise_, before_->toe);
  Before now = *before_;
  ++now.frames;
  now.lights = followed_lights(stored);
  const ModelledLight& main = now.lights.lights.front();
  const std::vector<Blocks> blocks = in_blocks(stored, now.shares.front());
  now.guide = guide_of(blocks, now.lights, now.shares);
  const PictureChange change = picture_change(before_->guide, now.guide);
  const auto unlike = std::accumulate(change.is_new.begin(), change.is_new.end(), std::size_t{0});
  if (static_cast<double>(unlike) > kMostly * static_cast<double>(change.is_new.size())) return {};
  if (!std::ranges::all_of(now.shares, &BlockShares::is_one)) {
    const std::size_t pixels = now.estimates.size();
    move(change, guide_size(pixels), blocks.front().columns, now.shares, now.estimates);
    if (is_due(now.estimates, now.frames)) estimate(blocks, now.lights, now.shares, now.estimates);
  }
  CleaningVerdict verdict = verdict_on(stored, 0, now.lights, now.shares);
  verdict.slow_bands = now.slow_bands;
  if (!objection_to(verdict).empty() || !objection_to_lines(main).empty()) return {};
  Frame frame{std::move(stored), {{now.lights}, now.shares, {verdict}, {}, {}}};
  before_ = std::move(now);
  return frame;
}

// The row light of each colour; colours that had one light have one again.
ColourLights StreamCleaner::followed_lights(const StoredScene& stored) const {
  const ColourLights& before = before_->lights;
  ColourLights found{{}, before.of_colour};
  for (std::size_t light = 0; light < before.lights.size(); ++light) {
    const auto first = static_cast<std::size_t>(std::ranges::find(before.of_colour, light) - before.of_colour.begin());
    const ModelledLight& own = before.lights[light];
    if (first == before.of_colour.size()) {  // of no colour any more: each of its group has one of its own
      found.lights.push_back(own);
      continue;
    }
    std::vector<BandedPicture> colours;
    for (std::size_t colour = first; colour < before.of_colour.size(); ++colour)
      if (before.of_colour[colour] == light) colours.push_back(stored.picture(0, colour));
    if (!own.tone) {
      found.lights.push_back(find_row_light(ColumnBundles(colours), own.model));
      continue;
    }
    Values of_columns(colours.front().columns);
    for (std::size_t n = 0; n < stored.rows(); ++n)
      for (std::size_t k = 0; k < of_columns.size(); ++k)
        of_columns[k] += share_at(before_->shares[first], n, k * stored.merged(), stored.columns()) /
                         static_cast<double>(stored.rows());
    ToneLight tone = refined_tone_light(ColumnBundles(colours, of_columns), Values(stored.rows(), 1.0), *own.tone);
    const double weight = 1 / static_cast<double>(std::min(before_->frames, kMostFrequencies) + 2);
    tone.frequency = std::lerp(own.tone->frequency, tone.frequency, weight);
    tone.second = std::lerp(own.tone->second, tone.second, weight);
    found.lights.push_back(ocisac::light_of(std::move(tone)));
  }
  return found;
}

}  // namespace ocisac
