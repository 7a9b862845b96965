#include "ocisac/camera/camera.hpp"

#include <string>

#include "ocisac/core/require.hpp"

namespace ocisac {

void check(const Camera& camera) {
  require_positive("row_time", camera.row_time);
  if (camera.exposure) require_not_negative("exposure", *camera.exposure);
  if (camera.frame_time) require_positive("frame_time", *camera.frame_time);
  check(camera.tone_curve);
}

double known_exposure(const Camera& camera, const char* purpose) {
  if (!camera.exposure)
    refuse("exposure", "none", std::string("the exposure of the camera in seconds, needed for ") + purpose);
  return *camera.exposure;
}

}  // namespace ocisac
