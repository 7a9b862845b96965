// From the signals of one light, frame after frame, to payloads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/chips/clock_tracker.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/packets/packets.hpp"
#include "ocisac/receiver/frame_order.hpp"
#include "ocisac/receiver/frame_reading.hpp"

namespace ocisac {

struct ChipOptions {
  // Hz, good to 2 %. Absent: found blind in the frames, which needs an exposure below a chip.
  std::optional<double> chip_rate;
  PacketFormat format{};
  // Passes over a frame's rows after which the search for its chips ends, which bounds its time; infinity: no bound.
  // Absent: 2000 where the camera's exposure is known, else 5000. A preamble is found in about 50.
  std::optional<double> search_passes{};
};

struct ReceivedFrame {
  std::int64_t frame = 0;
  FrameOutcome outcome = FrameOutcome::received;
  std::int64_t missing = 0;  // frames between the last one and this, by their numbers
  std::size_t colour = 0;    // colour that was read
  std::string bits;          // '0' and '1', 1 = bright; chips cut by the frame's edges left out
  double phase = 0;          // row at which the first of them begins, half an exposure after the light's own edge
  double rows_per_chip = 0;  // rows
  double rows_per_chip_std = 0;
  double exposure = 0;                   // s: the camera's, or estimated
  double exposure_std = 0;               // s; 0 where it is the camera's
  double snr = 0;                        // (half the swing)² / variance of a row about the model
  double error_rate = 0;                 // of the bits, expected by their log-likelihood ratios
  std::vector<double> llr;               // (bits) ln P(bright)/P(dark), nats
  std::optional<StretchReport> stretch;  // what the packet took of it
  Flags flags = 0;
};

// A result that holds nothing but the frame's number: numbers are NaN.
ReceivedFrame nothing_received(std::int64_t frame);

// The chips of one light, whose frames come in time order; any may be missing. In each frame the chip clock, the
// exposure and the levels are estimated (from the clock of the frames before, else from a preamble, else from the rate
// alone), the chips detected and put into the packet at their place on the light's clock. Memory is bounded.
class ChipReceiver {
 public:
  ChipReceiver(const Camera& camera, ChipOptions options);

  // `column`: the light's signal. `frame`: number, ascending. `first_row`: row of the picture at which it begins.
  ReceivedFrame push(const CombinedColumn& column, std::int64_t frame, std::size_t first_row);

  // Drops all but the bytes that the packet has: clock, channel, rate.
  void forget();

 private:
  std::optional<double> nominal_rows_per_chip(const CombinedColumn& column);
  [[nodiscard]] std::optional<FrameReading> follow(std::span<const double> signal, std::int64_t frame,
                                                   SearchEffort& effort) const;
  std::optional<FrameReading> search(const CombinedColumn& column, SearchEffort& effort);
  std::ptrdiff_t chip_number(const ChannelEstimate& channel, std::int64_t frame);
  void take(const FrameReading& reading, std::size_t rows, ReceivedFrame& result);
  void lose(ReceivedFrame& result, bool searched);

  Camera camera_;
  ChipOptions options_;
  PacketAssembler assembler_;
  std::vector<double> preamble_;
  std::optional<ClockTracker> tracker_;     // where the frame time is known; phases in rows of the picture
  std::optional<double> rows_per_chip_;     // nominal, or by the frames before
  std::optional<ChannelEstimate> channel_;  // of the last frame that was received
  double relative_noise_ = 0;               // of that frame, or somewhat less than of noisier ones before
  std::size_t first_row_ = 0;               // of the frame that is read
  std::size_t lost_ = 0;                    // frames in a row in which nothing was found
  std::size_t fruitless_ = 0, wait_ = 0;    // searches in a row; frames until the next
};

}  // namespace ocisac
