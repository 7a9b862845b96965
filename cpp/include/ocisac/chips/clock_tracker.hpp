// Tracks the chip clock of a light across frames and the rows that are not read in between.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

struct TrackerOptions {
  double frame_rows;              // rows from the beginning of a frame to that of the next: frame time / row time
  double frame_rows_std = 0;      // its standard error; estimated along with the clock
  double drift = 1e-6;            // random walk of the rate per frame, relative
  double exposure_wander = 1e-4;  // random walk of the exposure per frame, relative
};

// A clock relative to a frame; chips are numbered from the first frame on.
struct TrackedClock {
  ChipClock clock;        // phase: of chip `chip`, rows of this frame
  std::int64_t chip = 0;  // number of the chip that begins nearest the frame's first row
  ClockErrors errors;     // errors.chip: relative to `chip`
  double chips_lost =
      0;  // standard error of the count of chips since the last update; below kCountLost it can be relied on
};

// Kalman filter of phase, rows per chip and rows per frame, and of the exposure separately. Bounded memory, no
// allocation.
//
// Frames whose starts jitter jump about a steady clock. The variance of the starts is estimated from jumps at an
// unchanged rate that follow each other, or are below a quarter of a chip, and added to the noise of each phase.
class ClockTracker {
 public:
  explicit ClockTracker(const TrackerOptions& options);

  // Updates with the measurement of frame `frame`; ascending order, any frame may be missing. Frames by time stamps are
  // fractional. The count of chips
  // restarts, and false is returned, if the predicted phase has a standard error above kCountLost chips, or if the
  // clock deviates by more than kLostErrors standard errors (another light, a jump). The estimate of the rows per frame
  // is kept.
  bool update(double frame, const ChipClock& clock, const ClockErrors& errors);

  // Predicts the clock of a frame at or after the last update; absent before the first, and 10^15 chips after the last.
  [[nodiscard]] std::optional<TrackedClock> predict(double frame) const;

  // Time of the last update; absent before the first.
  [[nodiscard]] std::optional<double> last_frame() const { return started_ ? std::optional(frame_) : std::nullopt; }

  // The last update was where it was expected.
  [[nodiscard]] bool is_steady() const { return steady_ > 0; }

  // Other rows per frame from the last update on.
  void set_frame_rows(double rows, double standard_error);

  void reset();

 private:
  void begin(double frame, const ChipClock& clock, const ClockErrors& errors);
  [[nodiscard]] bool counts_to(double frame) const;

  TrackerOptions options_;
  bool started_ = false;
  double frame_ = 0;               // of the last update
  std::int64_t chip_ = 0;          // of `phase`
  std::array<double, 3> state_{};  // phase in frame_, rows per chip, rows per frame
  std::array<double, 9> covariance_{};
  double jitter_variance_ = 0;  // of frame starts, rows²
  int steady_ = 0;              // updates without a jump
  double exposure_ = 0, exposure_variance_ = 0;
};

inline constexpr double kLostErrors = 6;
inline constexpr double kCountLost = 0.2;

}  // namespace ocisac
