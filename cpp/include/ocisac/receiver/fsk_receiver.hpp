// Payloads from a stream of frames, each with one tone of a set.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/packets/fsk.hpp"
#include "ocisac/packets/packets.hpp"
#include "ocisac/receiver/frame_order.hpp"

namespace ocisac {

struct FskFrame {
  std::int64_t frame = 0;
  FrameOutcome outcome = FrameOutcome::received;
  std::int64_t missing = 0;              // number of frames missing before this one
  std::size_t colour = 0;                // received colour
  std::optional<FskSymbol> symbol;       // where received
  std::optional<StretchReport> stretch;  // its use by the packet
  Flags flags = 0;
};

// Receives packets (line code "none") sent with log₂ M bits per frame; the symbol clock is the frame clock. For each
// frame it combines the columns and detects the tone. The soft bits go to the packet, which finds preamble and header
// across frames. Frames without a tone, or missing, give erased bits. Memory is bounded.
class FskReceiver {
 public:
  // `tones`: as of FskDemodulator, the first is symbol 0. The exposure, where known, must leave a response of at least
  // kNearNull for each. Throws std::invalid_argument.
  FskReceiver(const Camera& camera, std::vector<double> tones, std::size_t block_bytes = 4,
              Preamble preamble = Preamble::standard);

  // `colours`: one frame, one view per colour. `frame`: its number, ascending; absent: the next one.
  FskFrame push(std::span<const AnyFramesView> colours, std::optional<std::int64_t> frame = {});

 private:
  void take(FskFrame& result);

  Camera camera_;
  std::vector<double> tones_;
  PacketAssembler assembler_;
  FrameOrder order_;
  std::optional<FskDemodulator> demodulator_;  // for this number of rows
  std::size_t rows_ = 0;
  std::optional<std::int64_t> last_;  // last frame with bits in the packet
};

}  // namespace ocisac
