#include <doctest/doctest.h>

#include "ocisac/core/version.hpp"

#ifdef OCISAC_EIGEN_FFT
#define CV_VERSION "none, Eigen's FFT"
#else
#include <opencv2/core/version.hpp>
#endif

TEST_CASE("the OpenCV that is loaded is the one whose headers were compiled, or none") {
  CHECK(ocisac::opencv_version() == CV_VERSION);
}
