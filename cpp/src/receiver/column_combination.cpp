#include "ocisac/receiver/column_combination.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <type_traits>

#include "ocisac/camera/linear_light.hpp"
#include "ocisac/receiver/edges.hpp"

namespace ocisac {

namespace {

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Eigen::Index;
using Eigen::VectorXd;

constexpr std::size_t kBlocks = 64;         // groups of neighbouring columns with a weight each
constexpr double kClippedShare = 0.01;      // columns with more saturated rows than this are left out
constexpr int kIterations = 8;              // of the factor model, and of the eigenvector within each
constexpr double kLeastOwnVariance = 0.01;  // of the strongest block: a block without noise must not take all

template <class T>
double clipping_level(const ToneCurve& curve) {
  if (std::is_floating_point_v<T> && curve.white_level == 0) return std::numeric_limits<double>::infinity();
  return 0.98 * white_level(curve, sample_maximum<T>());
}

std::vector<std::uint8_t> usable_columns(std::span<const double> clipped, SaturatedColumns saturated) {
  const double limit = std::max(kClippedShare, 2 * std::ranges::min(clipped));
  std::vector<std::uint8_t> usable(clipped.size());
  std::ranges::transform(clipped, usable.begin(), [&](double share) -> std::uint8_t {
    return saturated == SaturatedColumns::use || share <= limit;
  });
  return usable;
}

// Groups of neighbouring columns; `begin` has one more element, and columns that may not be used are in none.
struct Blocks {
  std::vector<std::size_t> begin, end;
  std::vector<std::size_t> size;  // usable columns
};

Blocks make_blocks(std::span<const std::uint8_t> usable) {
  Blocks blocks;
  const std::size_t groups = std::min(kBlocks, usable.size());
  for (std::size_t group = 0; group < groups; ++group) {
    const std::size_t begin = group * usable.size() / groups, end = (group + 1) * usable.size() / groups;
    const auto size = static_cast<std::size_t>(std::count(usable.begin() + static_cast<std::ptrdiff_t>(begin),
                                                          usable.begin() + static_cast<std::ptrdiff_t>(end), 1));
    if (size == 0) continue;
    blocks.begin.push_back(begin);
    blocks.end.push_back(end);
    blocks.size.push_back(size);
  }
  return blocks;
}

// Sums of unsigned integers stay exact in 64 bits; light is linear in them.
template <class T, class Sum, class Light>
Matrix sum_blocks(const FramesView<const T>& view, std::span<const std::uint8_t> usable, const Blocks& blocks,
                  Light light) {
  Matrix sums(static_cast<Index>(blocks.begin.size()), static_cast<Index>(view.rows));
  for (std::size_t row = 0; row < view.rows; ++row)
    for (std::size_t block = 0; block < blocks.begin.size(); ++block) {
      Sum sum = 0;
      for (std::size_t column = blocks.begin[block]; column < blocks.end[block]; ++column)
        if (usable[column]) sum += light(view(0, row, column));
      sums(static_cast<Index>(block), static_cast<Index>(row)) = static_cast<double>(sum);
    }
  return sums;
}

// Mean light of each block in each row: (blocks × rows).
template <class T>
Matrix block_means(const FramesView<const T>& view, const ToneCurve& curve, std::span<const std::uint8_t> usable,
                   const Blocks& blocks) {
  Matrix means;
  double dark = 0;
  if constexpr (std::is_integral_v<T>) {
    if (curve.kind == ToneCurve::Kind::linear) {
      means = sum_blocks<T, std::uint64_t>(view, usable, blocks, [](T value) { return value; });
      dark = curve.dark_level;
    } else {
      std::vector<double> table(std::size_t{std::numeric_limits<T>::max()} + 1);
      for (std::size_t value = 0; value < table.size(); ++value)
        table[value] = linear_light(curve, static_cast<double>(value), sample_maximum<T>());
      means = sum_blocks<T, double>(view, usable, blocks, [&](T value) { return table[value]; });
    }
  } else {
    means = sum_blocks<T, double>(view, usable, blocks, [&](T value) {
      return linear_light(curve, static_cast<double>(value), sample_maximum<T>());
    });
  }
  for (Index block = 0; block < means.rows(); ++block)
    means.row(block) =
        means.row(block).array() / static_cast<double>(blocks.size[static_cast<std::size_t>(block)]) - dark;
  return means;
}

// Covariance of the blocks' swings about their moving means: a gradient along the rows is not common light.
Matrix swing_covariance(const Matrix& means) {
  const auto rows = static_cast<std::size_t>(means.cols());
  Matrix swings = means;
  for (Index block = 0; block < means.rows(); ++block) {
    const auto slow = moving_mean({means.row(block).data(), rows}, rows / 16 + 1);
    swings.row(block) -= Eigen::Map<const Eigen::RowVectorXd>(slow.data(), means.cols());
  }
  return swings * swings.transpose() / static_cast<double>(rows);
}

}  // namespace

CommonFactor common_factor(std::span<const double> covariance, std::size_t size) {
  const auto n = static_cast<Index>(size);
  const Eigen::Map<const Matrix> matrix(covariance.data(), n, n);
  const VectorXd power = matrix.diagonal();
  const double floor = std::max(kLeastOwnVariance * power.maxCoeff(), 1e-12);
  VectorXd own = 0.5 * power, loadings = VectorXd::Ones(n);
  for (int outer = 0; outer < kIterations && !loadings.isZero(0); ++outer) {
    Matrix common = matrix;
    common.diagonal() -= own;
    for (int inner = 0; inner < kIterations; ++inner) {
      const VectorXd product = common * loadings;
      const double length = product.norm();
      if (length == 0)
        return {std::vector<double>(size, 0.0), {power.cwiseMax(floor).begin(), power.cwiseMax(floor).end()}};
      loadings = product / length;
    }
    loadings *= std::sqrt(std::max(loadings.dot(common * loadings), 0.0));
    own = (power.array() - loadings.array().square()).max(floor);
  }
  if (loadings.sum() < 0) loadings = -loadings;
  return {{loadings.begin(), loadings.end()}, {own.begin(), own.end()}};
}

std::vector<double> saturated_share(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve) {
  return std::visit(
      [&]<class T>(const FramesView<const T>& all) {
        const auto view = all.frame(frame);
        std::vector<std::uint32_t> counts(view.columns, 0);
        const double level = clipping_level<T>(curve);
        if (std::isfinite(level)) {
          const auto least = static_cast<T>(std::is_integral_v<T> ? std::ceil(level) : level);
          for (std::size_t row = 0; row < view.rows; ++row)
            for (std::size_t column = 0; column < view.columns; ++column)
              counts[column] += view(0, row, column) >= least;
        }
        std::vector<double> share(counts.begin(), counts.end());
        for (double& value : share) value /= static_cast<double>(view.rows);
        return share;
      },
      frames);
}

CombinedColumn combine_columns(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                               SaturatedColumns saturated) {
  const auto clipped = saturated_share(frames, frame, curve);
  const auto usable = usable_columns(clipped, saturated);
  const Blocks blocks = make_blocks(usable);
  const Matrix means =
      std::visit([&](const auto& view) { return block_means(view.frame(frame), curve, usable, blocks); }, frames);
  const Matrix covariance = swing_covariance(means);
  const std::size_t count = blocks.begin.size();
  const auto factor = common_factor({covariance.data(), count * count}, count);

  VectorXd weights(static_cast<Index>(count));
  double quality = 0, noise = 0;
  for (std::size_t block = 0; block < count; ++block) {
    weights(static_cast<Index>(block)) = std::max(factor.loadings[block], 0.0) / factor.own[block];
    quality += factor.loadings[block] * factor.loadings[block] / factor.own[block];
  }
  if (!(weights.sum() > 0)) weights.setOnes();
  weights /= weights.sum();

  CombinedColumn combined;
  const VectorXd signal = means.transpose() * weights;
  combined.signal.assign(signal.begin(), signal.end());
  combined.weights.assign(usable.size(), 0.0);
  for (std::size_t block = 0; block < count; ++block) {
    const double weight = weights(static_cast<Index>(block));
    noise += weight * weight * factor.own[block];
    for (std::size_t column = blocks.begin[block]; column < blocks.end[block]; ++column) {
      if (!usable[column]) continue;
      combined.weights[column] = weight / static_cast<double>(blocks.size[block]);
      combined.saturated |= weight > 0 && clipped[column] > kClippedShare;
    }
  }
  combined.noise = count > 1 ? std::sqrt(noise) : std::numeric_limits<double>::quiet_NaN();
  combined.quality = count > 1 ? quality : covariance(0, 0);
  return combined;
}

}  // namespace ocisac
