#include <doctest/doctest.h>

#include <algorithm>
#include <string>

#include "ocisac/core/version.hpp"

#ifdef OCISAC_EIGEN_FFT
#define CV_VERSION "none, Eigen's FFT"
#else
#include <opencv2/core/version.hpp>
#endif

TEST_CASE("version and commit have their forms") {
  const std::string version = ocisac::version();
  CHECK(std::count(version.begin(), version.end(), '.') == 2);
  CHECK(version.find_first_not_of("0123456789.") == std::string::npos);
  const std::string commit = ocisac::commit();
  CHECK((commit == "unknown" ||
         (commit.size() >= 7 && commit.find_first_not_of("0123456789abcdef") == std::string::npos)));
}

TEST_CASE("the OpenCV that is loaded is the one whose headers were compiled, or none") {
  CHECK(ocisac::opencv_version() == CV_VERSION);
}
