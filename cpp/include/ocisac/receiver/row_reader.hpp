// Chips of the rows of successive frames: the model of the rows that explains them, found from frame to frame.
#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/chips/clock_tracker.hpp"
#include "ocisac/chips/row_nuisance.hpp"
#include "ocisac/packets/packets.hpp"
#include "ocisac/receiver/frame_reading.hpp"

namespace ocisac {

// Frames until an attempt that may be in vain is due again: twice as many after each failure beyond the `quick` first.
struct BackOff {
  std::size_t shortest, longest;  // frames from one attempt to the next
  std::size_t quick = 1;
  std::size_t failures = 0, pause = shortest;  // in a row; frames until the next attempt

  void pass_frame() { pause -= pause > 0; }
  [[nodiscard]] bool is_due() const { return pause == 0; }
  [[nodiscard]] bool is_exhausted() const { return pause_after(failures) == longest; }
  void fail() { pause = pause_after(++failures); }
  void restart() { *this = {.shortest = shortest, .longest = longest, .quick = quick}; }
  // `vain`: failures in a row.
  [[nodiscard]] std::size_t pause_after(std::size_t vain) const {
    const std::size_t doublings = vain - std::min(vain, quick);
    return std::min(shortest << std::min<std::size_t>(doublings, 16), longest);
  }
};

struct ChipOptions {
  // Hz, accurate to 2 %. Absent: estimated blind from the frames, which requires an exposure below a chip.
  std::optional<double> chip_rate{};
  PacketFormat format{};
  // Upper bound of the passes over a frame's rows in the search for its chips; infinity: none. Absent: 2000 with a
  // known exposure of the camera, else 7000. A preamble is found in about 50.
  std::optional<double> search_passes{};
};

// Noise reduction that mixes the frame before into rows that differ from it by little: y_n = s_n + more·g(d_n)·d_n, d_n
// that frame less y_n, both of mean 0. g falls from 1 at `gate` to 0 at twice that: bright columns differ by more than
// dim ones.
struct FrameMixing {
  double more, gate;
};

// Nuisances in a frame's rows beside the chips, and the exposure.
struct SignalModel {
  RowNuisance nuisance{};
  std::optional<double> exposure_rows{};  // absent: estimated blind
  bool exposure_known = false;            // kept fixed
  bool slow_light = false;                // rise and fall are estimated
  bool loose_edges = false;               // edges lie off the clock
  bool warped = false;                    // rows are displaced
  std::optional<RowPause> pause{};
  std::optional<FrameMixing> mixing{};
  std::optional<std::ptrdiff_t> long_row{};  // of the picture; two exposures in turns (ChipClock)
};

// A model of a frame's rows, and where its reading begins: else from the tracked clock.
struct Hypothesis {
  SignalModel model;
  bool searches = false;  // for another clock
  bool refines = false;   // from the best reading so far
};

// State after the frames read so far, which predicts the next one.
struct LightState {
  std::optional<double> exposure{};          // s, stated of the current frame
  std::optional<double> rows_per_chip{};     // nominal, or estimated
  std::optional<ClockTracker> tracker{};     // with a known frame time; phases in rows of the picture
  std::optional<ChannelEstimate> channel{};  // of the last frame that was read
  bool fits = false;                         // that frame left no more than noise
  double mean = 1, variance = 0;             // of its rows
  SignalModel model{};                       // that explained it
  RowWarp warp{};                            // of the last frame that was displaced and fitted: a lens's stays
  std::vector<double> scale_beside{};        // that of slow light and tones beside the chips, RowNuisance::scale
  double relative_noise = 0;                 // max of the last frame's and of the decayed earlier values
  BackOff other_models{.shortest = 1, .longest = 16};

  // The state with a frame's reading as the last one, but for its clock and noise.
  void accept(const FrameReading& reading, std::span<const double> signal);
  // Mean of a frame over that of the last one read; 1 where a mean is not above 0: its dark level is not the light's.
  [[nodiscard]] double brightness_ratio(std::span<const double> signal) const;
  [[nodiscard]] std::optional<TrackedClock> predict(double time) const;
  // `first_row`: of the picture, at the channel's row 0. False where the tracker's count of chips restarts.
  bool track(const ChannelEstimate& channel, std::size_t first_row, double time);
  // (rows) of slow light and tones beside the chips from now on.
  void scale_nuisance(std::vector<double> scale);
};

// A frame's rows, and what its reading may cost.
struct FrameRows {
  std::vector<double> signal{};                   // in the light's rows, less its profile
  std::size_t first_row = 0;                      // of the picture, at index 0 of the signal
  double time = 0;                                // on the tracker's clock, in frames
  bool may_search = true;                         // a search for the clock is allowed if tracking fails
  SearchEffort effort{}, effort_of_others{};      // of models other than the last frame's
  std::vector<std::span<const double>> recent{};  // the same rows of recent frames
  std::vector<double> before{};                   // the same rows of the frame before, of mean 0; empty: none
  bool may_follow = true;                         // the clock of earlier frames is worth a try
  std::optional<bool> is_noise{};                 // the rows show no light; absent: not examined
};

// A frame as if the picture had these rows alone.
FrameRows part_of(FrameRows rows, const RowRange& part);

// The first, from row 0 of the picture on, of two rows whose light changes by much less from pair to pair than that of
// the next two and by less than the chips of a reading explain: these are exposed for less time.
std::optional<std::ptrdiff_t> longer_rows(const FrameRows& frame, const std::optional<FrameReading>& reading);

// True where the light changes by more to the middle row than to any other, in recent frames: the read-out may pause.
bool jumps_in_middle(const FrameRows& frame);
// True if the chips of a misfit lie off its clock by other parts of a chip before and after the middle row, and nowhere
// more than there. `signal`: the rows as they were read, since edges that may lie off the clock take up a jump.
bool clock_jumps(const FrameReading& reading, std::span<const double> signal);

struct RowsRead {
  std::optional<FrameReading> reading{};
  LightState state{};         // with the model that was chosen
  bool is_new_model = false;  // another one than the last frame's
};

// Rows without the frame before that noise reduction mixed into them.
std::vector<double> unmixed(const FrameRows& frame, const FrameMixing& mixing);

// The mixing that leaves least beside the chips of the best reading, on the predicted clock; absent where all leave
// nearly as much as that of its model.
std::optional<FrameMixing> mixing_of(const FrameRows& frame, const RowsRead& best);

// In each frame: chip clock, exposure and levels from the tracked clock, else from a preamble, else blind from the
// rate. The model of the last frame is tried first; if its residual exceeds noise, others until one fits.
class RowReader {
 public:
  RowReader(const Camera& camera, ChipOptions options);

  [[nodiscard]] const Camera& camera() const { return camera_; }
  [[nodiscard]] const ChipOptions& options() const { return options_; }
  [[nodiscard]] SearchEffort effort(const LightState& state, std::size_t rows) const;

  // Rows from the beginning of a frame to that of the next, other than frame time and row time say, of this tracker and
  // new ones.
  void set_frame_rows(double rows, ClockTracker& tracker);
  // `stamped`: frames have times, so that the frame time need not be known.
  [[nodiscard]] std::optional<ClockTracker> new_tracker(bool stamped) const;
  // The state before the first frame; the tracker keeps the camera's frame time.
  [[nodiscard]] LightState first_state(std::optional<ClockTracker> tracker) const;
  // The same, but for exposure and rate.
  [[nodiscard]] LightState restarted(const LightState& state) const;
  // The state with another stated exposure: the start of the estimate, if there is one.
  [[nodiscard]] LightState with_exposure(LightState state, std::optional<double> exposure) const;

  [[nodiscard]] RowsRead read(FrameRows& frame, LightState state) const;
  // With the state's model only.
  [[nodiscard]] std::optional<FrameReading> read_with(const SignalModel& model, FrameRows& frame,
                                                      const LightState& state) const;
  // True for rows of noise, which are not worth a search; once per frame.
  bool shows_no_light(FrameRows& frame, const LightState& state) const {
    return shows_no_light(frame.signal, frame, state);
  }
  // A tone that stands out of frames of `rows` rows; prominence 0: none.
  [[nodiscard]] StrongestTone prominent_tone(std::span<const double> signals, std::size_t rows,
                                             const LightState& state) const;

 private:
  bool shows_no_light(std::span<const double> signal, FrameRows& frame, const LightState& state) const;
  std::optional<FrameReading> read_as_displaced_before(const SignalModel& model, FrameRows& frame,
                                                       const LightState& state) const;
  std::optional<FrameReading> read_unmixed(const SignalModel& model, FrameRows& frame, const LightState& state) const;
  // Rows before and after a pause, each with a clock of their own.
  std::optional<FrameReading> read_about(const RowPause& pause, const SignalModel& model, FrameRows& frame,
                                         const LightState& state) const;
  // In the middle of a lamp's rows that begin with the picture; absent where one is known, or would leave few chips.
  [[nodiscard]] std::optional<RowPause> possible_pause(const FrameRows& frame, const LightState& state) const;
  // For the parts about a new pause: the channel of the whole.
  [[nodiscard]] LightState about_pause(const RowsRead& best, const FrameRows& frame) const;
  [[nodiscard]] SignalModel given_model(std::optional<double> exposure) const;
  [[nodiscard]] std::vector<RowNuisance> other_nuisances(const FrameRows& frame, const RowsRead& best) const;
  // Other models than that of the best reading, in the order in which they are tried.
  [[nodiscard]] std::vector<Hypothesis> hypotheses(const FrameRows& frame, const RowsRead& best) const;
  // The best reading is that by the hypothesis where it leaves less.
  bool try_hypothesis(const Hypothesis& hypothesis, const FrameRows& frame, RowsRead& best) const;
  std::optional<FrameReading> follow(std::span<const double> signal, const SignalModel& model, FrameRows& frame,
                                     const LightState& state, const RowsBeside* beside = nullptr) const;
  std::optional<FrameReading> follow_beside(const SignalModel& model, FrameRows& frame, const LightState& state) const;
  std::optional<FrameReading> search(std::span<const double> signal, const SignalModel& model, FrameRows& frame,
                                     const LightState& state) const;
  std::optional<FrameReading> search_slow(std::span<const double> signal, const SignalModel& model, FrameRows& frame,
                                          const LightState& state) const;
  std::optional<FrameReading> search_turns(std::span<const double> signal, const SignalModel& model, FrameRows& frame,
                                           const LightState& state) const;
  std::optional<FrameReading> search_exposures(std::span<const double> signal, const FrameSearch& wanted) const;

  Camera camera_;
  ChipOptions options_;
  std::vector<double> preamble_;
  std::optional<double> frame_rows_{};
};

}  // namespace ocisac
