// Settings of ocisac-rx from command line and configuration file.
#pragma once

#include <optional>
#include <string>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/scan_axis.hpp"
#include "ocisac/receiver/receiver.hpp"
#include "pixel_format.hpp"

namespace ocisac::apps {

// Separation of payloads on standard output.
enum class Delimiter { none, newline, length };

struct Settings {
  std::string input = "-";
  std::optional<FrameLayout> raw;         // absent: from the stream's header
  std::optional<std::string> timestamps;  // file of the frames' times
  ScanAxis scan_axis = ScanAxis::down;
  std::optional<Region> region;  // stored pixels
  Camera camera;
  std::optional<double> dark_level, white_level;  // absent: from the stream's header
  LightOptions light;
  std::size_t max_sources = 8;
  bool payload_alone = false;
  Delimiter delimiter = Delimiter::newline;
  bool stats = false;
  std::optional<std::size_t> frames;  // stop after this number
};

// Absent where the program has answered (--help, --version). Throws std::invalid_argument for invalid settings.
std::optional<Settings> read_settings(int argc, const char* const* argv);

}  // namespace ocisac::apps
