// The timing of a rolling-shutter camera and its response to light.
#pragma once

#include <cstddef>
#include <optional>

#include "ocisac/camera/tone_curve.hpp"

namespace ocisac {

// Row n of frame j ends its exposure at t = j·frame_time + n·row_time and begins it `exposure` earlier (seconds).
struct Camera {
  double row_time = 0;               // > 0
  std::optional<double> exposure;    // >= 0; unknown where absent
  std::optional<double> frame_time;  // > 0; unknown where absent
  ToneCurve tone_curve;
};

// Throws std::invalid_argument for values without meaning.
void check(const Camera& camera);

// `camera.exposure`, or std::invalid_argument that says that `purpose` needs it.
double known_exposure(const Camera& camera, const char* purpose);

}  // namespace ocisac
