// Payloads from the signals of one light in successive frames.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/packets/packets.hpp"
#include "ocisac/receiver/frame_order.hpp"
#include "ocisac/receiver/profile_learning.hpp"
#include "ocisac/receiver/row_model_search.hpp"

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

// Receives the chips of one light from frames in time order; any may be missing. It reads each frame's chips
// (RowModelSearch, ProfileLearning) and adds them to the packet at their place on the light's clock. Memory is bounded.
class ChipReceiver {
 public:
  ChipReceiver(const Camera& camera, ChipOptions options);

  // `column`: the light's signal. `frame`: number, ascending. `first_row`: row of the picture at index 0 of the signal.
  // `region`: rows of the signal in which the light was found; it ends there where no dark rows show its end.
  // `stamp`: its time joins frames instead of their numbers; its exposure and gain begin the estimates.
  ReceivedFrame push(const CombinedColumn& column, std::int64_t frame, std::size_t first_row, RowRange region,
                     const FrameStamp& stamp = {});

  // True while the lamp's profile is learned or used: the next frame's columns should be weighted as the last one's.
  [[nodiscard]] bool compares_rows(bool can_move) const { return kept_.compares_rows(can_move); }

  // Resets clock, channel and rate; the packet keeps its bytes.
  void forget();

 private:
  ReceivedFrame push_lit(const CombinedColumn& column, std::int64_t frame, std::size_t first_row, RowRange region,
                         const FrameStamp& stamp);
  void read_again(const FrameReading& reading, RowRange lit, const CombinedColumn& column, std::size_t first_row,
                  ReceivedFrame& result, std::optional<Payload>& payload);
  std::optional<Payload> learn(const std::optional<FrameReading>& reading, FrameRows& now, std::size_t first_row,
                               RowRange lit, ReceivedFrame& result);
  double drop_given_again();
  [[nodiscard]] ProfileLearning::UseReading use_of_earlier(ReceivedFrame& result, std::optional<Payload>& payload);
  std::pair<std::ptrdiff_t, PlaceErrors> chip_number(const ChannelEstimate& channel, double time);
  [[nodiscard]] double time_of(std::int64_t frame, const FrameStamp& stamp);
  bool repeats_last(const ReceivedFrame& result);
  void forget_repeated(const ReceivedFrame& result);
  void take(const FrameReading& reading, double time, std::span<const double> signal, ReceivedFrame& result);
  void lose(ReceivedFrame& result, const FrameRows& rows);

  ChipOptions options_;
  RowModelSearch rows_;
  ProfileLearning kept_;
  PacketAssembler assembler_;
  std::optional<double> stated_exposure_, reference_exposure_;  // s: the camera's; of the first frame that states one
  std::optional<double> last_stamp_;                            // s
  bool counted_ = false;                                        // this frame's place in the stream is stated
  std::int64_t repeats_ = 0;                                    // frames that were given twice, not counted
  std::string last_bits_;
  double last_phase_ = 0;
  std::ptrdiff_t count_base_ = 0;         // chips that the tracker counted before it restarted
  std::size_t lost_ = 0;                  // consecutive frames without chips
  std::size_t fruitless_ = 0, wait_ = 0;  // consecutive failed searches; frames until the next search
};

}  // namespace ocisac
