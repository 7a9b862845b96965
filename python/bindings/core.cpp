#include "bindings.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/version.hpp"

namespace ocisac::bindings {

void register_core(py::module_& module) {
  using py::arg;
  module.def("version", &version);
  module.def("commit", &commit);
  module.def("compiler", &compiler);
  module.def("opencv_version", &opencv_version);
  module.def("flag_names", &flag_names, arg("flags"));
}

}  // namespace ocisac::bindings
