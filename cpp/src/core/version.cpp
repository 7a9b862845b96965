#include "ocisac/core/version.hpp"

#include <opencv2/core/utility.hpp>

namespace ocisac {

const char* version() { return OCISAC_VERSION; }

const char* commit() { return OCISAC_COMMIT; }

const char* compiler() {
#if defined(__clang__)
  return "Clang " __clang_version__;
#elif defined(__GNUC__)
  return "GCC " __VERSION__;
#else
  return "unknown";
#endif
}

std::string opencv_version() { return cv::getVersionString(); }

}  // namespace ocisac
