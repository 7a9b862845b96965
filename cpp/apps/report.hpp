// Results of frames as JSON.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "latency.hpp"
#include "ocisac/receiver/receiver.hpp"
#include "pixel_format.hpp"

namespace ocisac::apps {

// Totals over all frames.
struct Totals {
  std::size_t frames = 0;     // complete
  std::size_t torn = 0;       // skipped
  std::size_t missing = 0;    // before them or between them, by --timestamps
  std::size_t with_data = 0;  // with detected chips
  std::size_t bits = 0;       // in these frames
  std::size_t blocks = 0;     // preambles with headers in these frames
  double share = 0;           // largest share of the bytes that a payload needs
  double rows_per_chip = 0;   // of the last frame with data
  std::size_t payloads = 0;
  std::size_t payload_bytes = 0;
  std::size_t searches = 0;  // number of searches for lights
  double seconds = 0;        // from the first frame to the end
};

// The line of a frame and light, with the keys of `ocisac receive --packets --json`. Numbers are the shortest text that
// parses to the same value, null where not finite; bytes that are not UTF-8 become U+FFFD. `region`: in stored pixels.
// `rows`: of the picture. `time`: of the frame, s.
std::string light_line(const LightFrame& light, const Region& region, std::size_t rows, const Camera& camera,
                       std::optional<double> time = {});
std::string totals_line(const Totals& totals);
// Why no payload was received. `shown_rows`: rows of a frame.
std::string no_payload_text(const Totals& totals, const PacketFormat& format, std::size_t shown_rows,
                            bool has_frame_time);
// Times in s. `computing`: from a frame's last byte to the end of its line; `first_frame`: the same for the first
// frame, which includes the search for lights; `ready`: from the start of the program until it waits for frames.
struct Stats {
  Latency computing;
  double first_frame = 0, ready = 0;
};
std::string stats_line(const Stats& stats);

std::string base64(std::span<const std::uint8_t> bytes);

}  // namespace ocisac::apps
