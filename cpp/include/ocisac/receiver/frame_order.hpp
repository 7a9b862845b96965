// What a stream of frames brings: which of them count, and their pixels as one signal.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

enum class FrameOutcome {
  received,     // chips were detected
  no_signal,    // no light with chips was found
  not_finite,   // pixels that are no numbers
  repeated,     // not after the last frame: left out
  other_shape,  // rows, columns or colours differ from the frame's before: left out
  unsearched,   // the clock is lost and the frames just before were searched in vain: left out, at most seven in a row
};

// received, no_signal, …
std::string_view outcome_name(FrameOutcome outcome);

// Which frames of a stream count: those that come after the last one and have its shape. What is taken for a fault at
// first is believed when kBelieved frames in a row agree on it: a count that began anew, another picture size.
class FrameOrder {
 public:
  struct Verdict {
    FrameOutcome outcome = FrameOutcome::received;  // or repeated, other_shape
    std::int64_t missing = 0;
    bool anew = false;  // the stream has begun anew with this frame: nothing that came before holds
  };
  // `lengths`: colours, rows, columns.
  Verdict admit(std::int64_t frame, const std::array<std::size_t, 3>& lengths);

  [[nodiscard]] std::int64_t next() const { return seen_ ? *seen_ + 1 : 0; }

  static constexpr std::size_t kBelieved = 8;

 private:
  std::optional<std::int64_t> last_, seen_;  // frame that counted; largest number
  std::optional<std::int64_t> behind_;       // last of the frames that were not after it
  std::array<std::size_t, 3> lengths_{}, others_{};
  std::size_t behind_count_ = 0, others_count_ = 0;
};

// Colours, rows and columns of one frame, one view a colour. Throws std::invalid_argument where these are no
// single frame, empty, or of different shapes.
std::array<std::size_t, 3> lengths_of(std::span<const AnyFramesView> colours);

// Whether all pixels are finite.
bool are_numbers(std::span<const AnyFramesView> colours);

// The colour in which the light stands out most, its columns combined.
std::pair<CombinedColumn, std::size_t> best_column(std::span<const AnyFramesView> colours, const ToneCurve& curve);

}  // namespace ocisac
