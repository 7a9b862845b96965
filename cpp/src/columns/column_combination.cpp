#include "ocisac/columns/column_combination.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <type_traits>

#include "columns/moving_mean.hpp"
#include "ocisac/camera/linear_light.hpp"

namespace ocisac {

namespace {

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Eigen::Index;
using Eigen::VectorXd;

constexpr std::size_t kBlocks = 64;              // groups of neighbouring columns with a weight each
constexpr double kClippedShare = 0.01;           // columns with more saturated rows than this are left out
constexpr double kTogether = 0.6, kApart = 0.3;  // cosines of the swings of one light, of different lights
constexpr std::size_t kMaxLights = 8;
constexpr int kIterations = 8;            // of the factor model, and of the eigenvector within each
constexpr double kMinOwnVariance = 0.01;  // of the strongest block: a block without noise must not take all

template <class T>
double clipping_level(const ToneCurve& curve) {
  if (std::is_floating_point_v<T> && curve.white_level == 0) return std::numeric_limits<double>::infinity();
  return 0.98 * white_level(curve, sample_maximum<T>());
}

std::vector<std::uint8_t> usable_columns(std::span<const double> clipped, SaturatedColumns saturated,
                                         std::span<const std::uint8_t> columns) {
  const auto allowed = [&](std::size_t column) { return columns.empty() || columns[column] != 0; };
  double least = 1;
  for (std::size_t column = 0; column < clipped.size(); ++column)
    if (allowed(column)) least = std::min(least, clipped[column]);
  const double limit = std::max(kClippedShare, 2 * least);
  std::vector<std::uint8_t> usable(clipped.size());
  for (std::size_t column = 0; column < clipped.size(); ++column)
    usable[column] = allowed(column) && (saturated == SaturatedColumns::use || clipped[column] <= limit);
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
  const bool dense = view.column_stride == 1;
  for (std::size_t row = 0; row < view.rows; ++row)
    for (std::size_t block = 0; block < blocks.begin.size(); ++block) {
      const std::size_t begin = blocks.begin[block], end = blocks.end[block];
      Sum sum = 0;
      if (dense && blocks.size[block] == end - begin) {  // no branches: the loop of nearly all pixels
        const T* values = &view(0, row, begin);
        for (std::size_t k = 0; k < end - begin; ++k) sum += light(values[k]);
      } else {
        for (std::size_t column = begin; column < end; ++column)
          if (usable[column]) sum += light(view(0, row, column));
      }
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
      means = sum_blocks<T, std::uint64_t>(view, usable, blocks, [](T value) { return std::uint32_t{value}; });
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

// The blocks' swings about their moving means: a gradient along the rows is not common light.
Matrix swings_of(const Matrix& means) {
  const auto rows = static_cast<std::size_t>(means.cols());
  Matrix swings = means;
  for (Index block = 0; block < means.rows(); ++block) {
    const auto slow = moving_mean({means.row(block).data(), rows}, rows / 16 + 1);
    swings.row(block) -= Eigen::Map<const Eigen::RowVectorXd>(slow.data(), means.cols());
  }
  return swings;
}

Matrix swing_covariance(const Matrix& means) {
  const Matrix swings = swings_of(means);
  return swings * swings.transpose() / static_cast<double>(means.cols());
}

// Blocks that see one light, with the one that shows it best.
struct BlockGroup {
  Index seed;
  std::vector<Index> members;
};

// Of the blocks that agree with no group's seed, the strongest that agrees with another of them begins the next group.
std::vector<BlockGroup> block_groups(const Matrix& cosines, const VectorXd& power) {
  const Index count = cosines.rows();
  std::vector<BlockGroup> groups;
  const auto is_apart = [&](Index block) {
    return std::ranges::all_of(groups, [&](const auto& g) { return std::abs(cosines(block, g.seed)) < kApart; });
  };
  while (groups.size() < kMaxLights) {
    Index seed = -1;
    for (Index i = 0; i < count; ++i) {
      if (!(power(i) > 0) || !is_apart(i) || (seed >= 0 && power(i) <= power(seed))) continue;
      for (Index j = 0; j < count; ++j)
        if (j != i && is_apart(j) && cosines(i, j) >= kTogether) seed = i;
    }
    if (seed < 0) break;
    groups.push_back({seed, {}});
  }
  for (Index block = 0; block < count; ++block)
    for (auto& group : groups) {
      const double own = cosines(block, group.seed);
      const bool best = std::ranges::all_of(groups, [&](const auto& g) { return cosines(block, g.seed) <= own; });
      if (own >= kApart && best) group.members.push_back(block);
    }
  return groups;
}

}  // namespace

CommonFactor common_factor(std::span<const double> covariance, std::size_t size) {
  const auto n = static_cast<Index>(size);
  const Eigen::Map<const Matrix> matrix(covariance.data(), n, n);
  const VectorXd power = matrix.diagonal();
  const double floor = std::max(kMinOwnVariance * power.maxCoeff(), 1e-12);
  VectorXd own = 0.5 * power, loadings = VectorXd::Ones(n);
  for (int outer = 0; outer < kIterations && !loadings.isZero(0); ++outer) {
    Matrix common = matrix;
    common.diagonal() -= own;
    for (int inner = 0; inner < kIterations; ++inner) {
      const VectorXd product = common * loadings;
      const double length = product.norm();
      if (length == 0) {
        const VectorXd variances = power.cwiseMax(floor);
        return {std::vector<double>(size, 0.0), {variances.begin(), variances.end()}};
      }
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
          for (std::size_t row = 0; row < view.rows; ++row) {
            if (view.column_stride == 1) {
              const T* values = &view(0, row, 0);
              for (std::size_t column = 0; column < view.columns; ++column) counts[column] += values[column] >= least;
            } else {
              for (std::size_t column = 0; column < view.columns; ++column)
                counts[column] += view(0, row, column) >= least;
            }
          }
        }
        std::vector<double> share(counts.begin(), counts.end());
        for (double& value : share) value /= static_cast<double>(view.rows);
        return share;
      },
      frames);
}

std::vector<LightGroup> light_groups(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve) {
  const auto usable = usable_columns(saturated_share(frames, frame, curve), SaturatedColumns::leave_out,
                                     std::span<const std::uint8_t>{});
  const Blocks blocks = make_blocks(usable);
  const Matrix swings = swings_of(
      std::visit([&](const auto& view) { return block_means(view.frame(frame), curve, usable, blocks); }, frames));
  const VectorXd power = swings.rowwise().squaredNorm();
  const VectorXd scale = (power.array() > 0).select(power.array().max(1e-300).sqrt().inverse(), 0.0);
  const Matrix cosines = scale.asDiagonal() * (swings * swings.transpose()) * scale.asDiagonal();
  const auto groups = block_groups(cosines, power);
  if (groups.size() < 2) return {};
  std::vector<LightGroup> lights;
  for (const auto& group : groups) {
    LightGroup light{std::vector<std::uint8_t>(usable.size(), 0), {}};
    Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(swings.cols());
    for (const Index block : group.members) {
      sum += swings.row(block);
      const auto at = static_cast<std::size_t>(block);
      for (std::size_t column = blocks.begin[at]; column < blocks.end[at]; ++column)
        light.columns[column] = usable[column];
    }
    sum.normalize();
    light.swings.assign(sum.begin(), sum.end());
    lights.push_back(std::move(light));
  }
  return lights;
}

double agreement(std::span<const double> signal, const LightGroup& group) {
  const auto slow = moving_mean(signal, signal.size() / 16 + 1);
  double product = 0, square = 0;
  for (std::size_t n = 0; n < signal.size(); ++n) {
    product += (signal[n] - slow[n]) * group.swings[n];
    square += (signal[n] - slow[n]) * (signal[n] - slow[n]);
  }
  return square > 0 ? product / std::sqrt(square) : 0.0;
}

CombinedColumn combine_columns(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                               SaturatedColumns saturated, std::span<const std::uint8_t> columns) {
  const auto clipped = saturated_share(frames, frame, curve);
  const auto usable = usable_columns(clipped, saturated, columns);
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
