// From a stream of frames to payloads: the receiver with a memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/estimation/flags.hpp"
#include "ocisac/receiver/clock_tracker.hpp"
#include "ocisac/receiver/packets.hpp"
#include "ocisac/receiver/refine_channel.hpp"
#include "ocisac/views.hpp"

namespace ocisac {

struct ReceiverOptions {
  // Hz, good to 2 %. Absent: found blind in the frames, which takes an exposure below a chip.
  std::optional<double> chip_rate;
  PacketFormat format{};
};

enum class FrameOutcome {
  received,     // chips were detected
  no_signal,    // no light with chips was found
  not_finite,   // pixels that are no numbers
  repeated,     // not after the last frame: left out
  other_shape,  // rows, columns or channels differ from the first frame's: left out
};

struct ReceivedFrame {
  std::int64_t frame = 0;
  FrameOutcome outcome = FrameOutcome::received;
  std::size_t channel = 0;   // colour channel that was read
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

// One light in frames that come in time order; any may be missing. Each frame's columns are combined, its chip clock,
// exposure and levels found (from the clock of the frames before, else from a preamble, else from the rate alone), its
// chips detected, and put into the packet at their place on the light's clock. Memory is bounded.
class Receiver {
 public:
  explicit Receiver(const Camera& camera, ReceiverOptions options = {});

  // `channels`: one frame, one view a colour channel. `frame`: its number, ascending; absent: one after the last.
  ReceivedFrame push(std::span<const AnyFramesView> channels, std::optional<std::int64_t> frame = {});

 private:
  std::optional<double> nominal_rows_per_chip(std::span<const AnyFramesView> channels);
  std::optional<RefinedChannel> find(std::span<const double> signal, std::int64_t frame, double rows_per_chip);
  [[nodiscard]] std::optional<RefinedChannel> follow(std::span<const double> signal, std::int64_t frame) const;
  [[nodiscard]] std::optional<RefinedChannel> search(std::span<const double> signal, double rows_per_chip) const;
  std::ptrdiff_t chip_number(const RefinedChannel& found, std::int64_t frame);
  void read(std::span<const double> signal, const RefinedChannel& found, ReceivedFrame& result);

  Camera camera_;
  ReceiverOptions options_;
  PacketAssembler assembler_;
  std::vector<double> preamble_;
  std::optional<ClockTracker> tracker_;     // where the frame time is known
  std::optional<double> rows_per_chip_;     // by the frames before
  std::optional<ChannelEstimate> channel_;  // of the last frame that was received
  std::optional<std::int64_t> last_;        // frame
  std::array<std::size_t, 3> shape_{};      // channels, rows, columns
};

}  // namespace ocisac
