// The timing of a rolling-shutter camera and its response to light.
#pragma once

#include <optional>

#include "ocisac/camera/tone_curve.hpp"

namespace ocisac {

// Row n of frame j ends its exposure at t = j·frame_time + n·row_time and begins it `exposure` earlier (seconds).
struct Camera {
  double row_time = 0;               // 1e-15 to 1
  std::optional<double> exposure;    // 0 to 1e15 row times; unknown where absent
  std::optional<double> frame_time;  // 1e-15 to 1e15 row times; unknown where absent
  ToneCurve tone_curve;
};

// Throws std::invalid_argument for values that are not finite or out of range.
void check(const Camera& camera);

// `camera.exposure`; throws std::invalid_argument that names `purpose` where it is absent.
double known_exposure(const Camera& camera, const char* purpose);

}  // namespace ocisac
