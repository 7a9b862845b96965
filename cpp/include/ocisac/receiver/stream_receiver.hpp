// From a stream of frames to payloads: the receiver with a memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/chips/clock_tracker.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/packets/packets.hpp"
#include "ocisac/receiver/frame_order.hpp"
#include "ocisac/receiver/frame_reading.hpp"

namespace ocisac {

struct ReceiverOptions {
  // Hz, good to 2 %. Absent: found blind in the frames, which takes an exposure below a chip.
  std::optional<double> chip_rate;
  PacketFormat format{};
  // Times that the search for the light's chips in one frame may go through its rows: bounds its time. Absent: no
  // limit.
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
  double exposure = 0;                   // rows: the camera's, or estimated
  double exposure_std = 0;               // 0 where it is the camera's
  double snr = 0;                        // (half the swing)² / variance of a row about the model
  double error_rate = 0;                 // of the bits, expected by their log-likelihood ratios
  std::vector<double> llr;               // (bits) ln P(bright)/P(dark), nats
  std::optional<StretchReport> stretch;  // what the packet took of it
  Flags flags = 0;
};

// A result that holds nothing but the frame's number: numbers are NaN.
ReceivedFrame nothing_received(std::int64_t frame);

// One light in frames that come in time order; any may be missing. Each frame's columns are combined, its chip clock,
// exposure and levels found (from the clock of the frames before, else from a preamble, else from the rate alone), its
// chips detected, and put into the packet at their place on the light's clock. Memory is bounded.
class Receiver {
 public:
  explicit Receiver(const Camera& camera, ReceiverOptions options = {});

  // `colours`: one frame, one view a colour. `frame`: its number, ascending; absent: one after the last.
  // `first_row`: where the views are a part of the picture, the row of the picture at which they begin.
  ReceivedFrame push(std::span<const AnyFramesView> colours, std::optional<std::int64_t> frame = {},
                     std::size_t first_row = 0);

 private:
  std::optional<double> nominal_rows_per_chip(std::span<const AnyFramesView> colours);
  [[nodiscard]] std::optional<FrameReading> follow(std::span<const double> signal, std::int64_t frame,
                                                   SearchEffort& effort) const;
  std::optional<FrameReading> search(std::span<const AnyFramesView> colours, std::span<const double> signal,
                                     SearchEffort& effort);
  std::ptrdiff_t chip_number(const ChannelEstimate& channel, std::int64_t frame);
  void take(const FrameReading& reading, std::size_t rows, ReceivedFrame& result);
  void lose(ReceivedFrame& result, bool searched);
  void forget();

  Camera camera_;
  ReceiverOptions options_;
  PacketAssembler assembler_;
  std::vector<double> preamble_;
  FrameOrder order_;
  std::optional<ClockTracker> tracker_;     // where the frame time is known; phases in rows of the picture
  std::optional<double> rows_per_chip_;     // nominal, or by the frames before
  std::optional<ChannelEstimate> channel_;  // of the last frame that was received
  double relative_noise_ = 0;               // of that frame, or somewhat less than of noisier ones before
  std::size_t first_row_ = 0;               // of the frame that is read
  std::size_t lost_ = 0;                    // frames in a row in which nothing was found
  std::size_t fruitless_ = 0, wait_ = 0;    // searches in a row; frames until the next
};

}  // namespace ocisac
