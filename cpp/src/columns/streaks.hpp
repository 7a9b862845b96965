// Light that is in a few columns for some rows only, as rain before the lamp.
#pragma once

#include <Eigen/Core>

namespace ocisac {

using ColumnLight = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;  // (rows, columns)

// True where few values of the columns hold most of what the combination with these weights (columns, their sum 1) does
// not explain. One row of `every` is examined.
bool has_streaks(const ColumnLight& columns, const Eigen::VectorXd& weights, Eigen::Index every);

// The combination, with values far off what a column is beside it replaced by that.
Eigen::VectorXd without_streaks(const ColumnLight& columns, const Eigen::VectorXd& weights);

}  // namespace ocisac
