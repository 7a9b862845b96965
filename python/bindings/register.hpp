#pragma once

#include <pybind11/pybind11.h>

namespace ocisac::bindings {

void register_build_info(pybind11::module_& module);
void register_camera(pybind11::module_& module);
void register_tone_gain(pybind11::module_& module);
void register_waveforms(pybind11::module_& module);
void register_best_exposure(pybind11::module_& module);
void register_equalize(pybind11::module_& module);
void register_frequency(pybind11::module_& module);
void register_receiver(pybind11::module_& module);
void register_channel(pybind11::module_& module);
void register_detection(pybind11::module_& module);
void register_projection(pybind11::module_& module);
void register_packets(pybind11::module_& module);
void register_sources(pybind11::module_& module);
void register_light_share(pybind11::module_& module);
void register_stream_receiver(pybind11::module_& module);
void register_scene(pybind11::module_& module);
void register_fsk(pybind11::module_& module);
void register_exposure_controller(pybind11::module_& module);

}  // namespace ocisac::bindings
