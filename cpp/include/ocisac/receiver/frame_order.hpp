// Frames of a stream: their order and shape, and their pixels as one signal.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string_view>

#include "ocisac/camera/camera.hpp"
#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

enum class FrameOutcome {
  received,     // chips were detected
  no_signal,    // no light with chips was detected
  not_finite,   // some pixels are not finite
  repeated,     // number not above the last frame's: skipped
  other_shape,  // rows, columns or colours differ from the last frame's: skipped
  unsearched,   // the clock is lost and recent searches failed: not searched, at most seven in a row
};

// received, no_signal, …
std::string_view outcome_name(FrameOutcome outcome);

// What the camera states of a frame; all may be absent.
struct FrameStamp {
  std::optional<std::int64_t> number{};  // ascending, missing frames count; absent: one after the last
  std::optional<double> time{};          // s, of the frame's first row, from any origin; of all frames or of none
  std::optional<double> exposure{};      // s, instead of the camera's
  std::optional<double> gain{};          // factor of the pixels' values, as automatic gain changes it
};

// Throws std::invalid_argument.
void check(const FrameStamp& stamp, Camera camera);

// Frames from one number to a later one, at most the largest number that there is: a camera may state any.
inline std::int64_t frames_between(std::int64_t first, std::int64_t last) {
  constexpr auto kMost = std::numeric_limits<std::int64_t>::max();
  return first < 0 && last > kMost + first ? kMost : last - first;
}

// Admits the frames that follow the last one and have its shape. A deviation counts as a fault until kBelieved frames
// in a row agree on it: a restarted count, or another picture size.
class FrameOrder {
 public:
  struct Admission {
    FrameOutcome outcome = FrameOutcome::received;  // or repeated, other_shape
    std::int64_t missing = 0;
    bool restarts = false;  // the stream restarts with this frame: state of earlier frames is invalid
  };
  // `lengths`: colours, rows, columns.
  Admission admit(std::int64_t frame, const std::array<std::size_t, 3>& lengths);

  // One after the largest number; the largest of all is repeated.
  [[nodiscard]] std::int64_t next() const {
    return seen_ ? *seen_ + (*seen_ < std::numeric_limits<std::int64_t>::max()) : 0;
  }

  static constexpr std::size_t kBelieved = 8;

 private:
  std::optional<std::int64_t> last_, seen_;  // last admitted frame; largest number
  std::optional<std::int64_t> behind_;       // last frame that did not follow it
  std::array<std::size_t, 3> lengths_{}, others_{};
  std::size_t behind_count_ = 0, others_count_ = 0;
};

// Colours, rows and columns of one frame, one view per colour. Throws std::invalid_argument where these are no single
// frame, empty, or of different shapes.
std::array<std::size_t, 3> lengths_of(std::span<const AnyFramesView> colours);

// True if all pixels are finite.
bool are_numbers(std::span<const AnyFramesView> colours);

// A colour with its columns combined.
struct ColourColumn {
  CombinedColumn column;
  std::size_t colour = 0;
};

// The colour of best quality.
ColourColumn best_column(std::span<const AnyFramesView> colours, const ToneCurve& curve);

}  // namespace ocisac
