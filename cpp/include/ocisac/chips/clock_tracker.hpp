// The clock of a light from frame to frame: what one frame told predicts the next, across the rows not read between.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

struct TrackerOptions {
  double frame_rows;              // rows from the beginning of a frame to that of the next: frame time / row time
  double frame_rows_std = 0;      // standard error of that; it is estimated along with the clock
  double drift = 1e-6;            // by which the rate wanders from one frame to the next (random walk), a share
  double exposure_wander = 1e-4;  // the same of the exposure
};

// A clock seen from a frame: chips are numbered from the first frame on.
struct TrackedClock {
  ChipClock clock;        // phase: of chip `chip`, rows of this frame
  std::int64_t chip = 0;  // number of the chip that begins nearest the frame's first row, since the first frame
  ClockErrors errors;     // errors.chip: relative to `chip`
  double chips_lost =
      0;  // standard error of the count of chips since the last update; below kCountLost it can be relied on
};

// Kalman filter of phase, rows per chip and rows per frame, the exposure beside it. Bounded memory, no allocation.
class ClockTracker {
 public:
  explicit ClockTracker(const TrackerOptions& options);

  // Takes in what frame `frame` told; frames in ascending order, any of them may be missing. Where the count of chips
  // since the last one cannot be relied on (prediction off by more than kCountLost chips' standard error), or the clock
  // is off by more than kLostErrors standard errors (another light, a jump), the count begins anew and false is
  // returned. What is known of the rows per frame stays.
  bool update(std::int64_t frame, const ChipClock& clock, const ClockErrors& errors);

  // The clock in a frame not before the last update; absent before the first.
  [[nodiscard]] std::optional<TrackedClock> predict(std::int64_t frame) const;

  void reset();

 private:
  void begin(std::int64_t frame, const ChipClock& clock, const ClockErrors& errors);

  TrackerOptions options_;
  bool started_ = false;
  std::int64_t frame_ = 0, chip_ = 0;  // of the last update; the chip that `phase` belongs to
  std::array<double, 3> state_{};      // phase in frame_, rows per chip, rows per frame
  std::array<double, 9> covariance_{};
  double exposure_ = 0, exposure_variance_ = 0;
};

inline constexpr double kLostErrors = 6;
inline constexpr double kCountLost = 0.2;

}  // namespace ocisac
