#include "columns/side_light.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <type_traits>

#include "core/linear_algebra.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_combination.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kMinColumns = 8;
constexpr double kShare = 0.25;  // of the columns

// Calls `take(row, column, light)` for every pixel of a frame.
template <class Take>
void for_each_pixel(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve, Take take) {
  std::visit(
      [&]<class T>(const FramesView<const T>& all) {
        const auto view = all.frame(frame);
        const auto light = [&](T value) {
          return linear_light(curve, static_cast<double>(value), sample_maximum<T>());
        };
        std::vector<double> table;
        if constexpr (std::is_integral_v<T>) {
          table.resize(std::size_t{std::numeric_limits<T>::max()} + 1);
          for (std::size_t value = 0; value < table.size(); ++value) table[value] = light(static_cast<T>(value));
        }
        for (std::size_t row = 0; row < view.rows; ++row)
          for (std::size_t column = 0; column < view.columns; ++column) {
            const T value = view(0, row, column);
            if constexpr (std::is_integral_v<T>)
              take(row, column, table[value]);
            else
              take(row, column, light(value));
          }
      },
      frames);
}

// Unsaturated columns whose variances along the rows are the smallest, with all that equal the largest of these.
std::vector<std::size_t> side_columns(std::span<const double> clipped, std::span<const double> variances) {
  std::vector<std::size_t> columns;
  std::vector<double> sorted;
  for (std::size_t column = 0; column < variances.size(); ++column)
    if (clipped[column] == 0) columns.push_back(column), sorted.push_back(variances[column]);
  if (sorted.empty()) return {};
  const auto at = sorted.begin() + static_cast<std::ptrdiff_t>(kShare * static_cast<double>(sorted.size() - 1));
  std::ranges::nth_element(sorted, at);
  std::erase_if(columns, [&](std::size_t column) { return variances[column] > *at; });
  return columns;
}

std::vector<double> column_variances(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve) {
  const Shape shape = shape_of(frames);
  std::vector<double> first(shape.columns), sums(shape.columns), squares(shape.columns);
  for_each_pixel(frames, frame, curve, [&](std::size_t row, std::size_t column, double light) {
    if (row == 0) first[column] = light;
    sums[column] += light - first[column];
    squares[column] += (light - first[column]) * (light - first[column]);
  });
  const auto rows = static_cast<double>(shape.rows);
  for (std::size_t column = 0; column < shape.columns; ++column)
    squares[column] = squares[column] / rows - sums[column] / rows * (sums[column] / rows);
  return squares;
}

}  // namespace

std::optional<SideLight> side_light(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                                    std::span<const double> weights) {
  const auto columns = side_columns(saturated_share(frames, frame, curve), column_variances(frames, frame, curve));
  const std::size_t rows = shape_of(frames).rows;
  if (columns.size() < kMinColumns || rows < 4) return std::nullopt;
  std::vector<std::uint8_t> half_of(weights.size(), 2);  // 0, 1: which half of the side columns; 2: none
  for (std::size_t k = 0; k < columns.size(); ++k) half_of[columns[k]] = static_cast<std::uint8_t>(k % 2);
  const std::array<double, 2> counts{static_cast<double>((columns.size() + 1) / 2),
                                     static_cast<double>(columns.size() / 2)};
  const auto size = static_cast<Eigen::Index>(rows);
  Eigen::MatrixXd halves = Eigen::MatrixXd::Zero(size, 2);
  Eigen::MatrixXd model = Eigen::MatrixXd::Zero(size, 3);  // constant, line, the lamp
  for_each_pixel(frames, frame, curve, [&](std::size_t row, std::size_t column, double light) {
    const auto n = static_cast<Eigen::Index>(row);
    model(n, 2) += weights[column] * light;
    if (half_of[column] < 2) halves(n, half_of[column]) += light / counts[half_of[column]];
  });
  model.col(0).setOnes();
  model.col(1).setLinSpaced(size, -1, 1);
  const Eigen::VectorXd mean = halves.rowwise().mean(), difference = 0.5 * (halves.col(0) - halves.col(1));
  const auto spread = [&](const Eigen::VectorXd& values) {
    return std::sqrt((values.array() - values.mean()).square().sum() / static_cast<double>(rows));
  };
  return SideLight{{mean.begin(), mean.end()}, spread(mean - model * least_squares(model, mean)), spread(difference)};
}

FrameWithout::FrameWithout(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                           std::span<const double> light)
    : rows_(shape_of(frames).rows), columns_(shape_of(frames).columns), pixels_(rows_ * columns_) {
  const auto clipped = saturated_share(frames, frame, curve);
  for_each_pixel(frames, frame, curve, [&](std::size_t row, std::size_t column, double value) {
    pixels_[row * columns_ + column] = clipped[column] > 0 ? 0.0F : static_cast<float>(value - light[row]);
  });
}

}  // namespace ocisac
