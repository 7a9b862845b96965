// Conversions of frequency searches and their results, shared by the rooms that find frequencies.
#pragma once

#include <optional>
#include <string>
#include <tuple>

#include "bindings.hpp"
#include "ocisac/camera/camera.hpp"
#include "ocisac/tones/find_frequency.hpp"

namespace ocisac::bindings {

using Bounds = std::optional<std::tuple<double, double>>;

// Bounds in Hz, converted to cycles per row.
FrequencySearch search_of(const Camera& camera, const Bounds& bounds, const std::string& waveform, bool select_columns);

// Cycles per row, its standard error, signal-to-noise ratio, highest harmonic, flags, columns (used, strength,
// saturated).
py::tuple tuple_of(const FoundFrequency& found);

}  // namespace ocisac::bindings
