// ocisac_fast._core: one register function a topic.
#include "register.hpp"

namespace py = pybind11;

// It needs no lock of the interpreter's: functions have no state of their own but a plan cache with a mutex, objects
// with a memory take one call at a time. tests/test_threads.py.
PYBIND11_MODULE(_core, module, py::mod_gil_not_used()) {
  module.doc() = "C++ core of ocisac_fast; use the package's own functions, which carry the documentation";
  ocisac::bindings::register_build_info(module);
  ocisac::bindings::register_camera(module);
  ocisac::bindings::register_tone_gain(module);
  ocisac::bindings::register_waveforms(module);
  ocisac::bindings::register_best_exposure(module);
  ocisac::bindings::register_equalize(module);
  ocisac::bindings::register_frequency(module);
  ocisac::bindings::register_receiver(module);
  ocisac::bindings::register_channel(module);
  ocisac::bindings::register_detection(module);
  ocisac::bindings::register_projection(module);
  ocisac::bindings::register_packets(module);
  ocisac::bindings::register_sources(module);
  ocisac::bindings::register_light_share(module);
  ocisac::bindings::register_stream_receiver(module);
  ocisac::bindings::register_scene(module);
  ocisac::bindings::register_fsk(module);
  ocisac::bindings::register_exposure_controller(module);
}
