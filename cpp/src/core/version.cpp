#include "ocisac/core/version.hpp"

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

}  // namespace ocisac
