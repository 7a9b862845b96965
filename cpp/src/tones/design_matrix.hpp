#pragma once

#include <Eigen/Core>

#include "ocisac/tones/tone_design.hpp"

namespace ocisac {

// ToneDesign::matrix as a matrix of its rows from `first_row` on.
inline Eigen::MatrixXd design_matrix(const ToneDesign& design, std::size_t first_row = 0) {
  const auto values = design.matrix(first_row);
  return Eigen::Map<const Eigen::MatrixXd>(values.data(), static_cast<Eigen::Index>(design.rows - first_row),
                                           static_cast<Eigen::Index>(design.columns()));
}

}  // namespace ocisac
