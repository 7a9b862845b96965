// Bayesian comparison of slow tones with none.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "ocisac/cleaning/slow_light.hpp"

namespace ocisac {

constexpr double least_cycles = 0.4;     // in the picture
constexpr double usual_harmonic = 0.35;  // size of the second harmonic, relative to the fundamental

// The likeliest slow tone in consecutive frames of one scene, as in the first of them, and its odds against none.
// `near`: a tone whose cycles and phase step are nearly those.
SlowTone find_slow_tone(std::span<const CommonCourse> courses, std::size_t rows, const Camera& camera,
                        const std::optional<SlowTone>& near);

// A tone of known cycles and phase step, its terms fitted again; `expected`: their size, for one or two harmonics.
SlowTone refitted_tone(std::span<const CommonCourse> courses, const SlowTone& tone,
                       const std::vector<double>& expected);

}  // namespace ocisac
