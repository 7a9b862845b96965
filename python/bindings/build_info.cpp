#include "ocisac/version.hpp"
#include "register.hpp"

namespace ocisac::bindings {

void register_build_info(pybind11::module_& module) {
  module.def("version", &version);
  module.def("commit", &commit);
  module.def("compiler", &compiler);
  module.def("opencv_version", &opencv_version);
}

}  // namespace ocisac::bindings
