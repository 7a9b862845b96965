// What the command line and the configuration file of ocisac-rx say.
#pragma once

#include <optional>
#include <string>

#include "ocisac/camera/camera.hpp"
#include "ocisac/receiver/receiver.hpp"
#include "pixel_format.hpp"

namespace ocisac::apps {

enum class ScanAxis { down, up, right, left };  // the way the rows go in time, in the stored picture

struct Settings {
  std::string input = "-";
  std::optional<FrameLayout> raw;  // absent: the stream tells its own
  ScanAxis scan_axis = ScanAxis::down;
  std::optional<StoredRegion> region;  // stored pixels
  Camera camera;
  std::optional<double> dark_level, white_level;  // absent: as the stream tells
  LightOptions light;
  std::size_t max_sources = 8;
  bool payload_alone = false;
  bool stats = false;
  std::optional<std::size_t> frames;  // stop after so many
};

// Nothing where the program has answered (--help, --version). Refused (std::invalid_argument): anything wrong.
std::optional<Settings> read_settings(int argc, const char* const* argv);

}  // namespace ocisac::apps
