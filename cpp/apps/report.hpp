// Results of frames as JSON.
#pragma once

#include <string_view>

#include "json_line.hpp"
#include "latency.hpp"
#include "ocisac/receiver/live_receiver.hpp"
#include "pixel_format.hpp"

namespace ocisac::apps {

// What happened to all frames.
struct Totals {
  std::size_t frames = 0;     // whole ones
  std::size_t torn = 0;       // left out
  std::size_t with_data = 0;  // in which chips were detected
  std::size_t bits = 0;       // of these
  std::size_t payloads = 0;
  std::size_t payload_bytes = 0;
  std::size_t searches = 0;  // for the light
  double seconds = 0;        // from the first frame to the end
};

// The line of a frame; `region`: in stored pixels.
std::string_view frame_line(JsonLine& line, const LiveFrame& frame, const StoredRegion& region, const Camera& camera);
std::string_view totals_line(JsonLine& line, const Totals& totals);
// Times in s. `computing`: from a frame's last byte to the end of its line; `first_frame`: the same of the first, with
// the search for the light; `ready`: from the start of the program until it waits for frames.
struct Stats {
  Latency computing;
  double first_frame = 0, ready = 0;
  std::size_t pool_bytes = 0;  // memory kept for frames; 0 where there is no pool
};
std::string_view stats_line(JsonLine& line, const Stats& stats);

}  // namespace ocisac::apps
