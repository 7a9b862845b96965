// Rows beyond the ends of a column, predicted from the nearest rows.
#pragma once

#include <Eigen/Core>
#include <cstddef>

namespace ocisac {

// The prediction is the conditional mean under a model of white-noise light after the exposure, plus a smooth component
// of 100 times its variance, and row noise of 1/1000 of its variance. It decays to zero, so that both ends join in the
// period of a DFT. Only the first rows beyond the end share light with rows of the column, one by one; the smooth
// component is of low rank. So the (predicted × used) weights are kept in two factors of a third of their size.
struct Continuation {
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  std::size_t used, predicted;  // rows
  std::size_t near;             // predicted rows that have an own term, the nearest ones
  Matrix terms;                 // (near + smooth terms × used) weights of the rows, the nearest to the end first
  Matrix smooth;                // (predicted × smooth terms) of the predicted rows, the nearest to the end first

  // Row i beyond the end is terms(i)·rows (if i < near) + smooth(i)·(terms of `near` and beyond)·rows.
};

Continuation continuation(std::size_t rows, double exposure_rows);

}  // namespace ocisac
