// Version, commit and compiler of this build, and the OpenCV at run time.
#pragma once

#include <string>

namespace ocisac {

/// Version of the library, "MAJOR.MINOR.PATCH".
const char* version();

/// Short hash of the commit it was built from; "unknown" when it was not built from a git checkout.
const char* commit();

/// Compiler that built the library, with its version.
const char* compiler();

/// Version of the OpenCV that is loaded at run time.
std::string opencv_version();

}  // namespace ocisac
