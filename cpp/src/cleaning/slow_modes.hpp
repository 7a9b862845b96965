// Cosine modes of the slow course of the rows.
#pragma once

#include <Eigen/Core>
#include <cstddef>

namespace ocisac {

constexpr double slowest_period = 64;  // rows per cycle, above which a light is slow
constexpr double most_cycles = 16;     // in the picture
constexpr double least_mode_variance = 1e-8;
constexpr double darkest_row = 0.02;  // of the light, of which a logarithm is taken; amplitudes may be above 1

// (places × count): cosines of order 1 to count.
Eigen::MatrixXd slow_modes(std::size_t places, std::size_t count);

}  // namespace ocisac
