// From a stream of frames that each show one tone of a set to payloads.
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
  std::int64_t missing = 0;              // frames between the last one and this, by their numbers
  std::size_t colour = 0;               // colour that was read
  std::optional<FskSymbol> symbol;       // where received
  std::optional<StretchReport> stretch;  // what the packet took of it
  Flags flags = 0;
};

// Packets (line code "none") whose bits are sent log₂ M a frame: the symbols' clock is that of the frames. Each frame's
// columns are combined and its tone detected; its soft bits go to the packet, where a preamble and a header are found
// across frames. Frames without a tone, or missing, leave their bits unseen. Memory is bounded.
class FskReceiver {
 public:
  // `tones`: as of FskDemodulator, the first the symbol 0; where the exposure is known it must leave at least
  // kMinFskResponse of each. Throws std::invalid_argument.
  FskReceiver(const Camera& camera, std::vector<double> tones, std::size_t block_bytes = 4,
              Preamble preamble = Preamble::standard);

  // `colours`: one frame, one view a colour. `frame`: its number, ascending; absent: one after the last.
  FskFrame push(std::span<const AnyFramesView> colours, std::optional<std::int64_t> frame = {});

 private:
  void take(FskFrame& result);

  Camera camera_;
  std::vector<double> tones_;
  PacketAssembler assembler_;
  FrameOrder order_;
  std::optional<FskDemodulator> demodulator_;  // for the rows of the frames
  std::size_t rows_ = 0;
  std::optional<std::int64_t> last_;  // frame whose bits went to the packet
};

inline constexpr double kMinFskResponse = 0.05;

}  // namespace ocisac
