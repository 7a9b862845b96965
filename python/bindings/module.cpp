// ocisac_fast._core: one register function a room.
#include "bindings.hpp"

// No lock of the interpreter is needed: functions have no state of their own but a plan cache with a mutex, objects
// with state take one call at a time. tests/core/test_threads.py.
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
