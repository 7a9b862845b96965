// Slow tones of the light of the rows, and their odds against none.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "ocisac/cleaning/slow_light.hpp"

namespace ocisac {

constexpr double least_cycles = 0.1;  // in the picture

// Tones in consecutive frames of one scene, as in the first of them, the strongest first; at least one. The last of
// several is sure, and the first one need not be. `near`: tones whose cycles and phase steps are nearly those.
std::vector<SlowTone> find_slow_tones(std::span<const CommonCourse> courses, std::size_t rows, const Camera& camera,
                                      std::span<const SlowTone> near);

// Tones of the mains, whose phase steps the clock of the camera gives.
bool are_of_mains(const std::vector<SlowTone>& tones, std::size_t rows, const Camera& camera);

// Tones of the same cycles and steps, whose terms follow those of the courses. `deviation`: of the new terms from the
// given ones.
std::vector<SlowTone> refitted_tones(std::span<const CommonCourse> courses, const std::vector<SlowTone>& tones,
                                     double deviation);

// The first `count` cosine modes of the log light of the tones.
std::vector<double> modes_of_light(std::span<const SlowTone> tones, std::size_t count);

}  // namespace ocisac
