// Oblique lamps: the slope of a light's columns along the rows, and frames sheared so that it stands upright.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <variant>
#include <vector>

#include "core/linear_algebra.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Slope of a light in columns per row; 0 if it is not significant: below six standard errors, or a movement of less
// than half of the light's standard deviation. `swings`: (rows × blocks) of groups of columns about their moving means;
// `centres`: (blocks) columns. Fits a line through the centroids of the light in windows of rows, each at the mean row
// of the window's light.
double lamp_slope(const ConstMatrix& swings, const Eigen::VectorXd& centres);

// One frame with each row shifted along the columns by slope·(row − middle row), rounded to whole columns; only columns
// inside the frame in all rows, at least one.
class UprightFrame {
 public:
  UprightFrame(const AnyFramesView& frames, std::size_t frame, double slope);

  [[nodiscard]] AnyFramesView view() const;
  // Weights of the frame's columns, averaged over the rows, from weights of the view's columns.
  [[nodiscard]] std::vector<double> own_weights(std::span<const double> weights) const;

 private:
  template <class T>
  void copy(const FramesView<const T>& view);

  std::variant<std::vector<std::uint8_t>, std::vector<std::uint16_t>, std::vector<float>, std::vector<double>> pixels_;
  std::vector<std::size_t> first_;  // (rows) column of the frame at which the view's begin
  std::size_t columns_, width_;     // of the frame, of the view
};

}  // namespace ocisac
