#include "ocisac/receiver/frame_order.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>

#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

std::string_view outcome_name(FrameOutcome outcome) {
  constexpr std::array names{"received", "no_signal", "not_finite", "repeated", "other_shape", "unsearched"};
  return names[static_cast<std::size_t>(outcome)];
}

void check(const FrameStamp& stamp, Camera camera) {
  if (stamp.time) require_finite("time", *stamp.time);
  if (stamp.exposure) require_positive("exposure", *stamp.exposure);
  camera.exposure = stamp.exposure;
  check(camera);
  if (stamp.gain) require_positive("gain", *stamp.gain);
}

FrameOrder::Admission FrameOrder::admit(std::int64_t frame, const std::array<std::size_t, 3>& lengths) {
  Admission admitted;
  if (last_ && frame <= *last_) {
    behind_count_ = behind_ && frame > *behind_ ? behind_count_ + 1 : 1;
    behind_ = frame;
    if (behind_count_ < kBelieved) return {FrameOutcome::repeated};
    admitted.restarts = true;
  }
  if (last_ && lengths != lengths_) {
    others_count_ = lengths == others_ ? others_count_ + 1 : 1;
    others_ = lengths;
    seen_ = std::max(seen_.value_or(frame), frame);
    if (others_count_ < kBelieved && !admitted.restarts) return {FrameOutcome::other_shape};
    admitted.restarts = true;
  }
  if (last_ && !admitted.restarts) admitted.missing = frames_between(*last_, frame) - 1;
  last_ = seen_ = frame;
  lengths_ = lengths;
  behind_.reset();
  behind_count_ = others_count_ = 0;
  return admitted;
}

ColourColumn best_column(std::span<const AnyFramesView> colours, const ToneCurve& curve) {
  ColourColumn best;
  for (std::size_t colour = 0; colour < colours.size(); ++colour) {
    auto column = combine_columns(colours[colour], 0, curve);
    if (colour == 0 || column.quality > best.column.quality) best = {std::move(column), colour};
  }
  return best;
}

// Shapes were checked before, so `check` can only throw for pixels that are not finite.
bool are_numbers(std::span<const AnyFramesView> colours) try {
  for (const auto& colour : colours) check(colour);
  return true;
} catch (const std::invalid_argument&) {
  return false;
}

std::array<std::size_t, 3> lengths_of(std::span<const AnyFramesView> colours) {
  require(!colours.empty(), "frame", "no colours", "at least one colour");
  const Shape shape = shape_of(colours.front());
  require(shape.frames == 1 && shape.rows > 0 && shape.columns > 0, "frame",
          std::to_string(shape.frames) + " frames of " + std::to_string(shape.rows) + " rows and " +
              std::to_string(shape.columns) + " columns",
          "one frame that is not empty");
  for (const auto& colour : colours) {
    const Shape other = shape_of(colour);
    require(other.frames == 1 && other.rows == shape.rows && other.columns == shape.columns, "frame",
            "colours of different shapes", "one shape");
  }
  return {colours.size(), shape.rows, shape.columns};
}

}  // namespace ocisac
