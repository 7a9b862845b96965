#include <pybind11/stl.h>

#include "ocisac/core/version.hpp"
#include "ocisac/tones/projection.hpp"
#include "register.hpp"

namespace ocisac::bindings {

void register_build_info(pybind11::module_& module) {
  module.def("version", &version);
  module.def("commit", &commit);
  module.def("compiler", &compiler);
  module.def("opencv_version", &opencv_version);
  module.def("simd_target", &simd_target);
  module.def("simd_targets", &simd_targets);
}

}  // namespace ocisac::bindings
