#include "ocisac/camera/camera.hpp"

#include <string>

#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

// Times beyond the limits are meant in another unit, or lose their digits in rows. Rows are 1 s where times are in
// rows.
void check(const Camera& camera) {
  const auto require_within = [](const char* name, double value, double low, double high) {
    if (value >= low && value <= high) return;  // the text takes longer than a short call
    require(false, name, value, shortest_text(low) + " to " + shortest_text(high) + " s");
  };
  require_within("row_time", camera.row_time, 1 / kMostCounted, 1);
  if (camera.exposure) require_within("exposure", *camera.exposure, 0, kMostCounted * camera.row_time);
  if (camera.frame_time)
    require_within("frame_time", *camera.frame_time, 1 / kMostCounted, kMostCounted * camera.row_time);
  check(camera.tone_curve);
}

double known_exposure(const Camera& camera, const char* purpose) {
  if (!camera.exposure)
    refuse("exposure", "none", std::string("the exposure of the camera in seconds, needed for ") + purpose);
  return *camera.exposure;
}

}  // namespace ocisac
