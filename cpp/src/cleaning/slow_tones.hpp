// Slow tones of the light of the rows and their odds against none.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "ocisac/cleaning/slow_light.hpp"

namespace ocisac {

constexpr double kLeastCycles = 0.1;  // in the picture
constexpr double kNearAtMost = 0.25;  // cycles between neighbouring tones that are tried
constexpr double kLeastModeVariance = 1e-8;
constexpr std::size_t kFewFrames = 3;  // show shares; a tone of less than a cycle fits them, whatever light they have

// Cycles in the picture of the fastest slow tone: of 58 rows, but at least 2.5 cycles and at most 16.
double most_cycles(std::size_t rows);

// (places × count): cosines of order 1 to count.
Eigen::MatrixXd slow_modes(std::size_t places, std::size_t count);

// Tones in consecutive frames of one scene, as in the first of them, the strongest first; at least one. The last of
// several is sure, and the first one need not be. `near`: tones whose cycles and phase steps are nearly those.
std::vector<SlowTone> find_slow_tones(std::span<const CommonCourse> courses, std::size_t rows,
                                      std::span<const SlowTone> near);

// Tones of the same cycles and steps, whose terms follow those of the courses. `deviation`: of the new terms from the
// given ones.
std::vector<SlowTone> refitted_tones(std::span<const CommonCourse> courses, const std::vector<SlowTone>& tones,
                                     double deviation);

// The first `count` cosine modes of the log light of the tones.
Eigen::VectorXd modes_of_light(std::span<const SlowTone> tones, std::size_t count);

// The tones with their phases in a later frame.
std::vector<SlowTone> in_frame(std::vector<SlowTone> tones, std::ptrdiff_t frame);

}  // namespace ocisac
