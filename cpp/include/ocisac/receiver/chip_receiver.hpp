// Payloads from the signals of one light in successive frames.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/chips/clock_tracker.hpp"
#include "ocisac/chips/row_nuisance.hpp"
#include "ocisac/chips/row_profile.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/packets/packets.hpp"
#include "ocisac/receiver/frame_order.hpp"
#include "ocisac/receiver/frame_reading.hpp"

namespace ocisac {

struct ChipOptions {
  // Hz, accurate to 2 %. Absent: estimated blind from the frames, which requires an exposure below a chip.
  std::optional<double> chip_rate;
  PacketFormat format{};
  // Upper bound of the passes over a frame's rows in the search for its chips; infinity: none. Absent: 2000 with a
  // known exposure of the camera, else 7000. A preamble is found in about 50.
  std::optional<double> search_passes{};
};

struct ReceivedFrame {
  std::int64_t frame = 0;
  FrameOutcome outcome = FrameOutcome::received;
  std::int64_t missing = 0;  // number of frames missing before this one
  std::size_t colour = 0;    // received colour
  std::string bits;          // '0' and '1', 1 = bright; without the chips cut by the frame's edges
  double phase = 0;          // row at which the first chip begins; half an exposure after the light's edge
  double rows_per_chip = 0;  // rows
  double rows_per_chip_std = 0;
  double exposure = 0;                   // s: the camera's, or estimated
  double exposure_std = 0;               // s; 0 if given by the camera
  double snr = 0;                        // (swing/2)² / variance of the rows about the model
  double error_rate = 0;                 // of the bits, expected from llr
  std::vector<double> llr;               // (bits) ln P(bright)/P(dark), nats
  std::optional<StretchReport> stretch;  // its use by the packet
  Flags flags = 0;
};

// A result without data for this frame; its numbers are NaN.
ReceivedFrame nothing_received(std::int64_t frame);

// Receives the chips of one light from frames in time order; any may be missing. In each frame it estimates chip clock,
// exposure and levels: from the tracked clock, else from a preamble, else blind from the rate. It then detects the
// chips and adds them to the packet at their place on the light's clock. Memory is bounded.
class ChipReceiver {
 public:
  ChipReceiver(const Camera& camera, ChipOptions options);

  // `column`: the light's signal. `frame`: number, ascending. `first_row`: row of the picture at index 0 of the signal.
  // `region`: rows of the signal in which the light was found; it ends there where no dark rows show its end.
  // `stamp`: its time joins frames instead of their numbers; its exposure and gain begin the estimates.
  ReceivedFrame push(const CombinedColumn& column, std::int64_t frame, std::size_t first_row, RowRange region,
                     const FrameStamp& stamp = {});

  // True while the lamp's profile is learned or used: the next frame's columns should be weighted as the last one's.
  [[nodiscard]] bool compares_rows() const;

  // Resets clock, channel and rate; the packet keeps its bytes.
  void forget();

 private:
  std::optional<double> nominal_rows_per_chip(const CombinedColumn& column);
  // Nuisances in a frame's rows beside the chips, and the exposure.
  struct RowModel {
    RowNuisance nuisance;
    std::optional<double> exposure_rows;  // absent: estimated blind
    bool exposure_known = false;          // kept fixed
    bool slow_light = false;              // rise and fall are estimated
  };
  // State of one frame during reception.
  struct Frame {
    const CombinedColumn& column;
    double time;                            // on the tracker's clock, in frames
    bool may_search;                        // a search for the clock is allowed if tracking fails
    SearchEffort effort, effort_of_others;  // of models other than the last frame's
    bool may_follow = true;                 // the clock of earlier frames is worth a try
    bool new_model = false;                 // another model than the last frame's was chosen
  };
  std::optional<FrameReading> read(std::span<const double> signal, Frame& frame);
  std::optional<FrameReading> read_with(std::span<const double> signal, RowModel& model, Frame& frame);
  [[nodiscard]] std::vector<double> kept_rows(std::size_t rows, double slow) const;
  [[nodiscard]] std::vector<RowModel> other_models(std::span<const double> signal, bool searches) const;
  bool try_models(std::span<const double> signal, bool searches, Frame& frame, std::optional<FrameReading>& best);
  [[nodiscard]] std::optional<FrameReading> follow(std::span<const double> signal, const RowModel& model,
                                                   Frame& frame) const;
  std::optional<FrameReading> search(std::span<const double> signal, const RowModel& model, Frame& frame);
  std::optional<FrameReading> search_slow(std::span<const double> signal, const RowModel& model, Frame& frame);
  [[nodiscard]] std::optional<FrameReading> search_exposures(std::span<const double> signal,
                                                             const FrameSearch& wanted) const;
  [[nodiscard]] double line_code_evidence(const FrameReading& reading) const;
  // A recent frame: its rows, and s of each where its chips are known.
  struct KeptFrame {
    std::int64_t number;
    double time;  // on the tracker's clock, in frames
    std::vector<double> signal, exposed;
    bool bright = false;  // its columns show a common light
    bool seen = false;    // chips were detected
    bool fits = false;    // no more than noise is left
    void expose(const FrameReading& reading, RowRange rows);
  };
  // The lamp's profile, the rows in which it is bright enough, and its fit to recent frames.
  struct LearnedProfile {
    RowProfile profile;
    RowRange rows;
  };
  void keep(const CombinedColumn& column, std::int64_t frame, double time, std::size_t first_row);
  void use_exposure(std::optional<double> exposure);
  ReceivedFrame push_lit(const CombinedColumn& column, std::int64_t frame, std::size_t first_row, RowRange region,
                         const FrameStamp& stamp);
  void restart_clock();
  void restart_tracker(bool stamped);
  [[nodiscard]] std::vector<ProfileFrame> profile_frames() const;
  [[nodiscard]] std::size_t profile_smoothing() const;
  bool learn_profile(const CombinedColumn& column, std::size_t first_row);
  struct KeptFit {
    std::size_t frames = 0;  // that fit
    double noise = 0;        // sum over the frames, relative to the swing
  };
  KeptFit read_kept(const LearnedProfile& learned, const CombinedColumn& column, std::size_t first_row,
                    ReceivedFrame* result);
  bool read_again(const FrameReading& reading, RowRange lit, const CombinedColumn& column, std::size_t first_row,
                  ReceivedFrame& result);
  void follow_profile(const std::optional<FrameReading>& reading);
  [[nodiscard]] SearchEffort search_effort(std::size_t rows) const;
  bool track(const ChannelEstimate& channel, double time);
  std::pair<std::ptrdiff_t, PlaceErrors> chip_number(const ChannelEstimate& channel, double time);
  [[nodiscard]] double time_of(std::int64_t frame, const FrameStamp& stamp);
  bool repeats_last(const ReceivedFrame& result);
  void forget_repeated(const ReceivedFrame& result);
  void take(const FrameReading& reading, double time, std::span<const double> signal, ReceivedFrame& result);
  void lose(ReceivedFrame& result, bool searched);

  Camera camera_;                                               // its exposure: of the current frame
  std::optional<double> stated_exposure_, reference_exposure_;  // s: the camera's; of the first frame that states one
  ChipOptions options_;
  PacketAssembler assembler_;
  std::vector<double> preamble_;
  std::optional<ClockTracker> tracker_;  // with a known frame time; phases in rows of the picture
  std::optional<double> last_stamp_;     // s
  bool counted_ = false;                 // this frame's place in the stream is stated
  std::int64_t repeats_ = 0;             // frames that were given twice, not counted
  std::string last_bits_;
  double last_phase_ = 0;
  std::ptrdiff_t count_base_ = 0;                         // chips that the tracker counted before it restarted
  std::optional<double> rows_per_chip_;                   // nominal, or estimated from earlier frames
  std::optional<ChannelEstimate> channel_;                // of the last received frame
  bool fits_ = false;                                     // that frame left no more than noise
  double variance_ = 0;                                   // of its rows
  double mean_ = 1;                                       // of its rows
  RowModel model_;                                        // that explained the last frame
  std::deque<KeptFrame> kept_;                            // the last frames, the current one included
  std::size_t kept_first_row_ = 0;                        // of the picture, at index 0 of their signals
  std::optional<LearnedProfile> profile_;                 // where single frames fit no model
  std::size_t profile_attempts_ = 0, until_attempt_ = 0;  // in vain; frames until the next
  std::size_t profile_misfits_ = 0;                       // consecutive frames that the profile does not explain
  double relative_noise_ = 0;                             // max of the last frame's and of the decayed earlier values
  std::size_t first_row_ = 0;                             // of the current frame
  std::size_t lost_ = 0;                                  // consecutive frames without chips
  std::size_t vain_tries_ = 0, until_try_ = 0;            // of other models in a row; frames until the next
  std::size_t fruitless_ = 0, wait_ = 0;                  // consecutive failed searches; frames until the next search
};

}  // namespace ocisac
