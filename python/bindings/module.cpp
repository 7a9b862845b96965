// ocisac_fast._core: one register function per room.
#include "bindings.hpp"

// The interpreter's lock is not needed: functions have no state except a plan cache with a mutex, and stateful objects
// accept one call at a time. tests/core/test_threads.py.
PYBIND11_MODULE(_core, module, pybind11::mod_gil_not_used()) {
  module.doc() = "C++ core of ocisac_fast; use the package's own functions, which carry the documentation";
  ocisac::bindings::register_core(module);
  ocisac::bindings::register_camera(module);
  ocisac::bindings::register_light(module);
  ocisac::bindings::register_tones(module);
  ocisac::bindings::register_exposure(module);
  ocisac::bindings::register_chips(module);
  ocisac::bindings::register_packets(module);
  ocisac::bindings::register_lights(module);
  ocisac::bindings::register_receiver(module);
  ocisac::bindings::register_cleaning(module);
  ocisac::bindings::register_scene(module);
}
