// Payloads from the signals of one light in successive frames.
#pragma once

#include <complex>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/packets/packets.hpp"
#include "ocisac/receiver/frame_order.hpp"
#include "ocisac/receiver/profile_learning.hpp"
#include "ocisac/receiver/row_reader.hpp"

namespace ocisac {

struct ReceivedFrame {
  std::int64_t frame = 0;
  FrameOutcome outcome = FrameOutcome::received;
  std::int64_t missing = 0;  // number of frames missing before this one
  std::size_t colour = 0;    // received colour
  std::string bits;          // '0' and '1', 1 = bright; without the chips cut by the frame's edges, or beyond doubt
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

// One frame of a light on its way to the packet.
struct ChipFrame {
  FrameRows rows{};
  ReceivedFrame result{};
  std::optional<FrameReading> reading{};
  std::ptrdiff_t first_chip = 0;     // number of the reading's first chip on the light's clock
  PlaceErrors place_errors{};        // of it
  bool repeats = false;              // the frame shows what the last one did
  RowRange lamp{};                   // of the rows, of a lamp that dark rows may end
  bool may_be_mean = false;          // of its neighbours, as the film has them between its frames
  std::optional<Payload> earlier{};  // completed by earlier frames, which were read again
};

// Evidence that each chip of a stream is read several times: all runs between edges are a multiple of some number of
// chips, by which the true ones are longer. A run is one with a probability of a half at most, of random chips and of a
// line code: one in three, and in Manchester code half of those that follow a run of two.
class ChipRuns {
 public:
  void add(std::span<const std::uint8_t> bits);
  [[nodiscard]] bool are_repeated() const;

 private:
  std::size_t common_ = 0;   // chips
  std::ptrdiff_t runs_ = 0;  // below 0 after others
};

// Evidence that the frame time counts the chips between frames while the stamps do not, which may be rounded to
// milliseconds: the turns of the chip clock from frame to frame have one direction by the right times, whatever error
// the frame time has, and by wrong ones any.
class FrameTimes {
 public:
  // A frame's time by its stamp, in frames; returns the time to believe.
  double next(double stamped);
  // The chip clock of a frame at that time; others are passed over. True if the frame time is believed from now on.
  bool add(double time, const ChipClock& clock, double frame_rows);

 private:
  double stamped_ = kNaN, even_ = kNaN;              // of this frame, in frames
  double last_stamped_ = kNaN, last_even_ = kNaN;    // of the last one whose clock is known
  double last_phase_ = kNaN;                         // rows
  std::complex<double> stamped_turns_, even_turns_;  // sums over pairs of frames
  double most_late_ = 0, most_early_ = 0;            // stamps, beside even times; rows
  std::size_t pairs_ = 0;
  bool are_even_ = false;
};

// Receives the chips of one light from frames in time order; any may be missing. Memory is bounded. The steps of a
// frame, in this order:
class ChipReceiver {
 public:
  ChipReceiver(const Camera& camera, ChipOptions options);

  // The rows that the light reaches, less its profile where one is known. `column`: the light's signal. `frame`:
  // number, ascending. `first_row`: row of the picture at index 0 of the signal. `region`: rows of the signal in which
  // the light was found; it ends there where no dark rows show its end. `stamp`: its time joins frames instead of their
  // numbers; its exposure and gain begin the estimates.
  ChipFrame explain(CombinedColumn column, std::int64_t frame, std::size_t first_row, RowRange region,
                    const FrameStamp& stamp);
  // Its chips, by a model of the rows (RowReader), which may be learned from several frames (learn_profile). Frames
  // that it explains and earlier models did not are read again, placed and decoded.
  void read(ChipFrame& frame);
  // The chips' numbers on the light's clock.
  void place(ChipFrame& frame);
  // Adds the chips to the packet.
  ReceivedFrame decode(ChipFrame frame);

  // True while the lamp's profile is learned or used: the next frame's columns should be weighted as the last one's.
  [[nodiscard]] bool compares_rows(bool can_move) const { return history_.compares_rows(can_move); }

  // Resets clock, channel and rate; the packet keeps its bytes.
  void forget();

 private:
  void make_as_bright(CombinedColumn& column, const FrameStamp& stamp);
  double time_of(std::int64_t frame, const FrameStamp& stamp);
  double drop_given_again();
  [[nodiscard]] bool is_mean(const ChipFrame& frame) const;
  RowsRead read_lamp(ChipFrame& frame);
  bool learn(ChipFrame& frame);
  void restart_packet(bool all);
  void read_again(ChipFrame& frame, const LearnedProfile& profile, LightState state);
  void count_chips(ChipFrame& frame);
  void set_frame_rows(double rows);
  void pass_idle(std::int64_t frame, bool is_mean);
  bool repeats_last(const ReceivedFrame& result);
  void lose(ChipFrame& frame);

  RowReader reader_;
  LightState state_;
  FrameHistory history_;
  PacketAssembler assembler_;
  std::optional<double> reference_exposure_;      // s, of the first frame that states one
  std::optional<double> last_stamp_;              // s
  FrameTimes times_;                              // of stamped frames
  bool counted_ = false;                          // this frame's place in the stream is stated
  std::optional<std::int64_t> first_frame_;       // of the tracker's clock
  std::int64_t repeats_ = 0;                      // frames that were given twice, not counted
  std::int64_t last_idle_ = 0;                    // the last frame that showed nothing new
  std::int64_t idle_gap_ = 2;                     // frames from the one before to it
  int alternating_ = 0;                           // gaps of two in a row
  bool means_ = false;                            // it was the mean of its neighbours
  std::size_t dark_before_ = 0, dark_after_ = 0;  // rows of the signal that a lamp did not reach
  ChipRuns runs_;
  std::string last_bits_;
  double last_phase_ = 0;
  std::ptrdiff_t count_base_ = 0;                // chips that the tracker counted before it restarted
  std::ptrdiff_t end_chip_ = 0;                  // after those of the last frame
  std::size_t lost_ = 0;                         // consecutive frames without chips
  BackOff search_{.shortest = 1, .longest = 8};  // for the clock
};

}  // namespace ocisac
