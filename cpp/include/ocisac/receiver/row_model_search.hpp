// Chips of the rows of successive frames: the model of the rows that explains them, found from frame to frame.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/chips/clock_tracker.hpp"
#include "ocisac/chips/row_nuisance.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/packets/packets.hpp"
#include "ocisac/receiver/frame_reading.hpp"

namespace ocisac {

// Nuisances in a frame's rows beside the chips, and the exposure.
struct SignalModel {
  RowNuisance nuisance;
  std::optional<double> exposure_rows;  // absent: estimated blind
  bool exposure_known = false;          // kept fixed
  bool slow_light = false;              // rise and fall are estimated
  bool warped = false;                  // rows are displaced
};

// State of one frame during reception.
struct FrameRows {
  const CombinedColumn& column;
  double time;                                        // on the tracker's clock, in frames
  bool may_search;                                    // a search for the clock is allowed if tracking fails
  SearchEffort effort, effort_of_others;              // of models other than the last frame's
  std::span<const std::span<const double>> recent{};  // the same rows of recent frames
  bool may_follow = true;                             // the clock of earlier frames is worth a try
  bool new_model = false;                             // another model than the last frame's was chosen
  std::optional<bool> is_noise{};                     // the rows show no light; absent: nobody asked
};

// State estimated from the frames read so far, which predicts the next one.
struct LightState {
  std::optional<ClockTracker> tracker;     // with a known frame time; phases in rows of the picture
  std::optional<ChannelEstimate> channel;  // of the last received frame
  bool fits = false;                       // that frame left no more than noise
  double mean = 1, variance = 0;           // of its rows
  SignalModel model;                       // that explained it
  double relative_noise = 0;               // max of the last frame's and of the decayed earlier values
  std::size_t first_row = 0;               // of the current frame
  std::vector<double> scale_beside;        // that of slow light and tones beside the chips
};

struct RowSearchOptions {
  std::optional<double> chip_rate;      // as of ChipOptions
  std::optional<double> search_passes;  // as of ChipOptions
  PacketFormat format{};
};

// In each frame: chip clock, exposure and levels from the tracked clock, else from a preamble, else blind from the
// rate. The model of the last frame is tried first; if its residual exceeds noise, others until one fits.
class RowModelSearch {
 public:
  RowModelSearch(const Camera& camera, RowSearchOptions options);

  [[nodiscard]] LightState& state() { return state_; }
  [[nodiscard]] const LightState& state() const { return state_; }
  [[nodiscard]] const Camera& camera() const { return camera_; }
  [[nodiscard]] std::optional<double> rows_per_chip() const { return rows_per_chip_; }
  [[nodiscard]] SearchEffort effort(std::size_t rows) const;

  // The next frames' exposure, s: the start of the estimate, if there is one.
  void use_exposure(std::optional<double> exposure);

  // `stamped`: frames have times, so that the frame time need not be known.
  void restart_tracker(bool stamped);
  // The state before the first frame, but for the rate.
  void restart_clock();
  // The same with the rate.
  void forget();
  // (rows) of slow light and tones beside the chips from now on, RowNuisance::scale.
  void scale_beside(std::vector<double> scale);
  // The next rows have levels of 0 and 1. The model stays, and where `readable`, of the clock all but its phase.
  void restart_phase(bool readable);
  // Rise and fall belong to the model from now on, starting from those of a moderately slow light. False where they do,
  // and where no frame was read.
  bool start_slow_light();
  // A tone that stands out of frames of `rows` rows; prominence 0: none.
  [[nodiscard]] StrongestTone prominent_tone(std::span<const double> signals, std::size_t rows) const;

  std::optional<FrameReading> read(std::span<const double> signal, FrameRows& frame);
  // With the model of the last frame only.
  std::optional<FrameReading> read_with_last(std::span<const double> signal, FrameRows& frame) {
    return read_with(signal, state_.model, frame);
  }
  // True for rows of noise, which are not worth a search; once per frame.
  bool shows_no_light(std::span<const double> signal, FrameRows& frame) const;
  // The reading is that of the last frame from now on, but for its clock and noise.
  void accept(const FrameReading& reading, std::span<const double> signal);
  // The chips' rate is known from a reading that fits.
  void keep_rate(const ChannelEstimate& channel) { rows_per_chip_ = channel.clock.rows_per_chip; }
  // False where the tracker's count of chips restarts.
  bool track(const ChannelEstimate& channel, double time);
  [[nodiscard]] std::optional<TrackedClock> predict(double time) const;

 private:
  std::optional<double> nominal_rows_per_chip(const CombinedColumn& column);
  [[nodiscard]] double brightness_ratio(std::span<const double> signal) const;
  bool may_search(std::span<const double> signal, FrameRows& frame) const;
  std::optional<FrameReading> read_with(std::span<const double> signal, SignalModel& model, FrameRows& frame);
  [[nodiscard]] std::vector<RowNuisance> other_nuisances(std::span<const double> signal, const FrameRows& frame) const;
  [[nodiscard]] std::vector<SignalModel> other_models(std::span<const double> signal, const FrameRows& frame,
                                                      bool searches) const;
  void examine(const FrameReading& reading, bool in_vain);
  [[nodiscard]] bool is_examined(const FrameReading& reading) const;
  bool try_models(std::span<const double> signal, bool searches, FrameRows& frame, std::optional<FrameReading>& best);
  [[nodiscard]] std::optional<FrameReading> follow(std::span<const double> signal, const SignalModel& model,
                                                   FrameRows& frame, const RowsBeside* beside = nullptr) const;
  [[nodiscard]] std::optional<FrameReading> go_on(std::span<const double> signal, const SignalModel& model,
                                                  FrameRows& frame) const;
  std::optional<FrameReading> search(std::span<const double> signal, const SignalModel& model, FrameRows& frame);
  std::optional<FrameReading> search_slow(std::span<const double> signal, const SignalModel& model, FrameRows& frame);
  [[nodiscard]] std::optional<FrameReading> search_exposures(std::span<const double> signal,
                                                             const FrameSearch& wanted) const;

  Camera camera_;  // its exposure: of the current frame
  RowSearchOptions options_;
  std::vector<double> preamble_;
  LightState state_;
  std::optional<double> rows_per_chip_;         // nominal, or estimated from earlier frames
  std::size_t vain_tries_ = 0, until_try_ = 0;  // of other models in a row; frames until the next
  std::size_t examined_ = 0;                    // tries in vain, chips being sure, since one found a model
  double unexplained_ = 0;                      // max relative noise that they left
};

}  // namespace ocisac
