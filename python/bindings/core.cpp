#include "bindings.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/interrupt.hpp"
#include "ocisac/core/version.hpp"

namespace ocisac::bindings {

namespace {

// Ctrl-C: Python's handlers run only in the main thread; in other threads this does nothing.
void check_signals() {
  const py::gil_scoped_acquire acquired;
  if (PyErr_CheckSignals() != 0) throw py::error_already_set();
}

}  // namespace

void register_core(py::module_& module) {
  using py::arg;
  set_interrupt_check(&check_signals);
  module.def("version", &version);
  module.def("commit", &commit);
  module.def("compiler", &compiler);
  module.def("opencv_version", &opencv_version);
  module.def("is_viewable", &is_viewable, arg("array"));
  module.def("flag_names", &flag_names, arg("flags"));
}

}  // namespace ocisac::bindings
