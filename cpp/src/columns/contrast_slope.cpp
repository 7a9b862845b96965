#include "columns/contrast_slope.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <variant>
#include <vector>

#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kApart = 2;       // columns: neighbours share light by optics and interpolation
constexpr std::size_t kMaxPairs = 256;  // of columns, evenly spaced
constexpr int kGroups = 8;              // of rows; the least number of pairs
constexpr double kAlike = 0.35;         // (a − b)/(a + b) of the depths of a pair
constexpr double kFloor = 1.0 / 64;     // of the brightest row

// Light of pairs of columns that do not saturate: (rows × pairs).
struct PairedColumns {
  MatrixXd first, second;

  [[nodiscard]] PairedColumns only(const std::vector<Index>& pairs) const {
    return {first(Eigen::all, pairs), second(Eigen::all, pairs)};
  }
};

PairedColumns paired_columns(const AnyFramesView& frames, std::size_t frame, const Region& box,
                             const ToneCurve& curve) {
  const double saturation = saturation_level(frames, curve);
  return std::visit(
      [&](const auto& view) {
        const std::size_t all = box.width > kApart ? box.width - kApart : 0, step = 1 + all / kMaxPairs;
        const auto light = [&](std::size_t offset) {
          return MatrixXd::NullaryExpr(
              static_cast<Index>(box.height), static_cast<Index>((all + step - 1) / step),
              [&, offset](Index n, Index pair) {
                return static_cast<double>(view(frame, box.y + static_cast<std::size_t>(n),
                                                box.x + static_cast<std::size_t>(pair) * step + offset));
              });
        };
        const PairedColumns stored{light(0), light(kApart)};
        std::vector<Index> clear;
        for (Index pair = 0; pair < stored.first.cols(); ++pair)
          if (!(stored.first.col(pair).array().max(stored.second.col(pair).array()) >= saturation).any())
            clear.push_back(pair);
        PairedColumns columns = stored.only(clear);
        columns.first.array() -= curve.dark_level, columns.second.array() -= curve.dark_level;
        return columns;
      },
      frames);
}

// Depth of the course in each of the columns, relative to the column's mean and in the course's unit.
VectorXd depths(const MatrixXd& columns, const VectorXd& course) {
  const VectorXd sums = columns.colwise().sum(), swing = course.array() - course.mean();
  return (sums.array() > 0).select((columns.transpose() * swing).cwiseQuotient(sums), 0.0);
}

// Pairs of columns that show the same light in the same depth; beside a lamp's edge they do not.
std::vector<Index> alike_pairs(const PairedColumns& columns, const VectorXd& course) {
  const VectorXd first = depths(columns.first, course), second = depths(columns.second, course);
  const double largest = std::max(first.maxCoeff(), 0.0);
  std::vector<Index> alike;
  for (Index k = 0; k < first.size(); ++k)
    if (std::min(first(k), second(k)) > kMostly * largest &&
        std::abs(first(k) - second(k)) <= kAlike * (first(k) + second(k)))
      alike.push_back(k);
  return alike;
}

// Relative squared contrast between the columns, and log light, of each two adjacent rows. False where the rows have no
// light or no contrast.
bool find_contrast(const PairedColumns& columns, VectorXd& contrast, VectorXd& light) {
  const VectorXd means = 0.5 * (columns.first + columns.second).rowwise().sum();
  const MatrixXd apart = columns.second - columns.first;
  const double floor = kFloor * means.maxCoeff();
  if (!(floor > 0)) return false;
  const Index count = means.size() - 1;
  const Eigen::ArrayXd level = means.array().max(0.0) + floor, both = level.head(count) * level.tail(count);
  contrast = apart.topRows(count).cwiseProduct(apart.bottomRows(count)).rowwise().sum().array() / both;
  light = 0.5 * both.log();
  const double mean = contrast.mean();
  contrast /= mean;
  return mean > 0;
}

// Σ contrast·course / Σ light·course, and its jackknife over groups of rows, in each of which the course has no line.
ContrastSlope slope_of(const VectorXd& contrast, const VectorXd& light, const VectorXd& course) {
  Eigen::Array<double, kGroups, 1> products, lights;
  const Index count = contrast.size();
  VectorXd along = course.head(count) + course.tail(count);
  for (Index group = 0; group < kGroups; ++group) {
    const Index begin = group * count / kGroups, size = (group + 1) * count / kGroups - begin;
    remove_line({&along(begin), static_cast<std::size_t>(size)});
    products(group) = contrast.segment(begin, size).dot(along.segment(begin, size));
    lights(group) = light.segment(begin, size).dot(along.segment(begin, size));
  }
  const double slope = products.sum() / lights.sum();
  const auto scatter = ((products.sum() - products) / (lights.sum() - lights) - slope).square().sum();
  const double std = std::sqrt(scatter * (kGroups - 1) / kGroups);
  return std::isfinite(std) ? ContrastSlope{slope, std} : ContrastSlope{};
}

}  // namespace

bool ContrastSlope::is_of_texture() const {
  return -2 - slope > kSure * std;  // more than a veil's
}

ContrastSlope contrast_slope(const AnyFramesView& frames, std::size_t frame, const Region& box,
                             const ToneCurve& curve) {
  const PairedColumns columns = paired_columns(frames, frame, box, curve);
  if (columns.first.cols() < kGroups || box.height < 4 * kGroups) return {};
  const VectorXd course = columns.first.rowwise().sum();
  const std::vector<Index> pairs = alike_pairs(columns, course);
  VectorXd contrast, light;
  if (std::ssize(pairs) < kGroups || !find_contrast(columns.only(pairs), contrast, light)) return {};
  return slope_of(contrast, light, course);
}

}  // namespace ocisac
