#include "ocisac/columns/column_combination.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <type_traits>
#include <utility>

#include "columns/dense_rows.hpp"
#include "columns/lamp_slope.hpp"
#include "columns/moving_mean.hpp"
#include "columns/row_kernels.hpp"
#include "columns/streaks.hpp"
#include "core/levels.hpp"
#include "core/linear_algebra.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_blocks.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/region.hpp"

namespace ocisac {

namespace {

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Eigen::Index;
using Eigen::VectorXd;

constexpr double kApart = 0.3;                                   // cosine between swings of different lights, at most
constexpr std::size_t kWeightsInterval = 2, kSlopeInterval = 8;  // frames of a followed light between estimates
constexpr double kBeside = 0.25;   // of the blocks are beside the light at least: those of least weight
constexpr Index kStreakRows = 16;  // one of so many is examined for streaks

std::vector<std::uint8_t> usable_columns(std::span<const double> clipped, bool use_saturated,
                                         std::span<const std::uint8_t> columns) {
  const auto allowed = [&](std::size_t column) { return columns.empty() || columns[column] != 0; };
  double lowest = 1;
  for (std::size_t column = 0; column < clipped.size(); ++column)
    if (allowed(column)) lowest = std::min(lowest, clipped[column]);
  const double limit = std::max(kNextToNone, 2 * lowest);
  std::vector<std::uint8_t> usable(clipped.size());
  for (std::size_t column = 0; column < clipped.size(); ++column)
    usable[column] = allowed(column) && (use_saturated || clipped[column] <= limit);
  return usable;
}

using Blocks = std::vector<IndexRange>;  // of columns

// Groups of neighbouring columns; groups without a usable column are omitted.
Blocks make_blocks(std::span<const std::uint8_t> usable) {
  Blocks blocks;
  const std::size_t groups = std::min(kMaxBlocks, usable.size());
  for (std::size_t group = 0; group < groups; ++group) {
    const IndexRange block{group * usable.size() / groups, (group + 1) * usable.size() / groups};
    if (std::ranges::count(usable.subspan(block.begin, block.size()), 1) > 0) blocks.push_back(block);
  }
  return blocks;
}

// (rows × blocks) sums of `light` over each block's usable columns; those of integers are exact.
template <class T, class Light>
void sum_blocks(const FramesView<const T>& view, std::span<const std::uint8_t> usable, const Blocks& blocks,
                Light light, Matrix& sums) {
  for (std::size_t row = 0; row < view.rows; ++row)
    for (std::size_t block = 0; block < blocks.size(); ++block) {
      const T* values = view.at(0, row, blocks[block].begin);
      decltype(light(T{})) sum = 0;
      for (std::size_t column = blocks[block].begin; column < blocks[block].end; ++column, values += view.column_stride)
        sum += usable[column] != 0 ? light(*values) : 0;
      sums(static_cast<Index>(row), static_cast<Index>(block)) = static_cast<double>(sum);
    }
}

// Light of each block and row, summed over its columns, into `sums`, (rows × blocks), whose memory is reused. Returns
// the dark level still contained in every column.
template <class T>
double block_sums(const FramesView<const T>& view, const ToneCurve& curve, std::span<const std::uint8_t> usable,
                  const Blocks& blocks, Matrix& sums) {
  sums.resize(static_cast<Index>(view.rows), static_cast<Index>(blocks.size()));
  const auto sum = [&](auto light) { sum_blocks(view, usable, blocks, light, sums); };
  if constexpr (std::is_integral_v<T>) {
    if (curve.kind == ToneCurve::Kind::linear) {
      sum([](T value) -> std::uint32_t { return value; });
      return curve.dark_level;
    }
    sum([table = light_table(view, curve)](T value) { return table->light[value]; });
  } else {
    sum([&](T value) { return linear_light(curve, static_cast<double>(value), sample_maximum<T>()); });
  }
  return 0;
}

// Rows either side of the moving mean about which a light swings: many, so that slow light swings.
Index reach_of(Index rows) { return rows / 16 + 1; }

// Swings of the blocks about their moving means over rows n − reach … n + reach, which removes gradients along the
// rows, times `scale`. count·x − Σx is exact for integers, so constant columns have exactly zero swing.
void take_swings(const Matrix& sums, const Eigen::RowVectorXd& scale, Matrix& swings) {
  const Index rows = sums.rows(), reach = reach_of(rows);
  swings.resize(rows, sums.cols());
  Eigen::RowVectorXd window = sums.topRows(std::min(reach, rows)).colwise().sum();
  Index length = std::min(reach, rows);
  for (Index row = 0; row < rows; ++row) {
    if (row + reach < rows) window += sums.row(row + reach), ++length;
    if (row > reach) window -= sums.row(row - reach - 1), --length;
    const auto count = static_cast<double>(length);
    swings.row(row) = ((count * sums.row(row) - window) * (1 / count)).cwiseProduct(scale);
  }
}

}  // namespace

// Blocks of a frame with their light. Half a megabyte, reused from frame to frame: a new allocation per frame costs as
// much as the sums (page faults).
struct BlockedFrame {
  std::vector<double> clipped;       // (columns) fraction of saturated rows
  std::vector<std::uint8_t> usable;  // (columns)
  Blocks blocks;
  Eigen::RowVectorXd sizes;  // (blocks) usable columns
  Matrix means, swings;      // (rows × blocks)

  void fill(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve, bool use_saturated,
            std::span<const std::uint8_t> columns) {
    clipped = saturated_share(frames, frame, curve);
    usable = usable_columns(clipped, use_saturated, columns);
    blocks = make_blocks(usable);
    const double dark = std::visit(
        [&](const auto& view) { return block_sums(view.frame(frame), curve, usable, blocks, means); }, frames);
    sizes = sums_of_blocks({usable.begin(), usable.end()});
    const Eigen::RowVectorXd scale = sizes.cwiseInverse();
    take_swings(means, scale, swings);
    for (Index row = 0; row < means.rows(); ++row)
      means.row(row) = (means.row(row).array() * scale.array() - dark).matrix();
  }

  [[nodiscard]] VectorXd sums_of_blocks(const std::vector<double>& of_columns) const {
    return VectorXd::NullaryExpr(std::ssize(blocks), [&](Index block) {
      const IndexRange& columns = blocks[static_cast<std::size_t>(block)];
      return std::accumulate(of_columns.begin() + static_cast<std::ptrdiff_t>(columns.begin),
                             of_columns.begin() + static_cast<std::ptrdiff_t>(columns.end), 0.0);
    });
  }
};

namespace {

double min_own_variance(const VectorXd& power) { return std::max(kNextToNone * power.maxCoeff(), 1e-12); }

// Blocks of one light, and the block that represents it.
struct BlockGroup {
  Index seed;
  std::vector<Index> members;
};

// True if a block between two others shows the light of neither.
bool has_gap(const Matrix& cosines, Index first, Index last) {
  for (Index k = std::min(first, last) + 1; k < std::max(first, last); ++k)
    if (std::abs(cosines(k, first)) < kApart && std::abs(cosines(k, last)) < kApart) return true;
  return false;
}

// The next seed is the strongest block that is apart from all seeds and correlates with another such block. Beyond a
// gap, blocks are apart unless they are together: two blocks of one light that correlate with its seed by less than
// kTogether correlate with each other by less than its square, while swings of two lights are alike by chance up to
// 0.4. Without a gap, blocks of an oblique lamp change little by little.
std::vector<BlockGroup> block_groups(const Matrix& cosines, const VectorXd& power) {
  const Index count = cosines.rows();
  std::vector<BlockGroup> groups;
  const auto is_apart = [&](Index block) {
    return std::ranges::all_of(groups, [&](const auto& g) {
      const double alike = std::abs(cosines(block, g.seed));
      return alike < kApart || (alike < kTogether && has_gap(cosines, block, g.seed));
    });
  };
  for (;;) {
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
  const double floor = min_own_variance(power);
  VectorXd own = 0.5 * power, loadings = VectorXd::Ones(n);
  for (int outer = 0; outer < kMaxIterations && !loadings.isZero(0); ++outer) {
    Matrix common = matrix;
    common.diagonal() -= own;
    for (int inner = 0; inner < kMaxIterations; ++inner) {
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

// The smallest sample at or above a finite level; none where the level exceeds the type.
template <class T>
static std::optional<T> lowest_at_or_above(double level) {
  const double lowest = std::is_integral_v<T> ? std::ceil(level) : level;
  if (lowest > static_cast<double>(std::numeric_limits<T>::max())) return std::nullopt;
  return static_cast<T>(std::max(lowest, static_cast<double>(std::numeric_limits<T>::lowest())));
}

// False if all samples of a row lie below `level`; the maximum of contiguous integers takes few instructions.
template <class T>
static bool reaches(const FramesView<const T>& view, std::size_t row, T level) {
  if (!std::is_integral_v<T> || view.column_stride != 1) return true;
  const T* values = view.at(0, row, 0);
  T highest = 0;
  for (std::size_t column = 0; column < view.columns; ++column) highest = std::max(highest, values[column]);
  return highest >= level;
}

std::vector<double> saturated_share(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve) {
  return std::visit(
      [&]<class T>(const FramesView<const T>& all) {
        const auto view = all.frame(frame);
        std::vector<std::uint32_t> counts(view.columns, 0);
        const double level = saturation_level<T>(curve);
        const auto lowest = std::isfinite(level) ? lowest_at_or_above<T>(level) : std::nullopt;
        for (std::size_t row = 0; lowest && row < view.rows; ++row) {
          if (!reaches(view, row, *lowest)) continue;
          for (std::size_t column = 0; column < view.columns; ++column)
            counts[column] += view(0, row, column) >= *lowest;
        }
        std::vector<double> share(counts.begin(), counts.end());
        for (double& value : share) value /= static_cast<double>(view.rows);
        return share;
      },
      frames);
}

double agreement(std::span<const double> signal, const LightGroup& group) {
  const auto slow = moving_mean(signal, static_cast<std::size_t>(reach_of(std::ssize(signal))));
  double product = 0, square = 0;
  for (std::size_t n = 0; n < signal.size(); ++n) {
    product += (signal[n] - slow[n]) * group.swings[n];
    square += (signal[n] - slow[n]) * (signal[n] - slow[n]);
  }
  return square > 0 ? product / std::sqrt(square) : 0.0;
}

namespace {

// True if the light leaves both edges of the frame dark.
bool has_sides(std::span<const double> weights, std::span<const double> clipped) {
  const double lit = kSmallShare * *std::ranges::max_element(weights);
  const auto is_dark = [&](std::size_t column) { return weights[column] < lit && clipped[column] <= kNextToNone; };
  return is_dark(0) && is_dark(weights.size() - 1);
}

// Combination with weights a/v of the blocks. `factor`: model of the covariance of their swings.
CombinedColumn combined(const BlockedFrame& frame, const CommonFactor& factor) {
  const std::size_t count = frame.blocks.size();
  const Eigen::Map<const Eigen::ArrayXd> loadings(factor.loadings.data(), static_cast<Index>(count)),
      own(factor.own.data(), static_cast<Index>(count));
  VectorXd weights = loadings.max(0.0) / own;
  if (!(weights.sum() > 0)) weights.setOnes();
  weights /= weights.sum();

  CombinedColumn result;
  const VectorXd signal = frame.means * weights;
  result.signal.assign(signal.begin(), signal.end());
  result.weights.assign(frame.usable.size(), 0.0);
  for (std::size_t block = 0; block < count; ++block) {
    const double weight = weights(static_cast<Index>(block));
    for (std::size_t column = frame.blocks[block].begin; column < frame.blocks[block].end; ++column) {
      if (!frame.usable[column]) continue;
      result.weights[column] = weight / frame.sizes(static_cast<Index>(block));
      result.saturated |= weight > 0 && frame.clipped[column] > kNextToNone;
    }
  }
  for (std::size_t column = 0; column < frame.usable.size(); ++column)
    result.left_out |= !frame.usable[column] && frame.clipped[column] > kNextToNone;
  result.noise = count > 1 ? std::sqrt((weights.array().square() * own).sum()) : kNaN;
  result.quality = (loadings.square() / own).sum();
  result.has_sides = has_sides(result.weights, frame.clipped);
  return result;
}

// Columns per row by which the blocks' light moves.
double slope_of(const BlockedFrame& frame) {
  const VectorXd centres = VectorXd::NullaryExpr(std::ssize(frame.blocks), [&](Index block) {
    const auto& [begin, end] = frame.blocks[static_cast<std::size_t>(block)];
    return 0.5 * static_cast<double>(begin + end - 1);
  });
  return lamp_slope(Eigen::MatrixXd(frame.swings), centres);
}

// `products`: of the blocks' swings, summed over the rows.
CombinedColumn combined_from_products(const BlockedFrame& frame, const Eigen::MatrixXd& products) {
  const Eigen::MatrixXd covariance = products / static_cast<double>(frame.swings.rows());
  const auto count = static_cast<std::size_t>(covariance.rows());
  auto result = combined(frame, common_factor({covariance.data(), count * count}, count));
  if (count == 1) result.quality = covariance(0, 0);
  return result;
}

CombinedColumn combined_from_covariance(const BlockedFrame& frame) {
  return combined_from_products(frame, gram(frame.swings.transpose()));
}

// One step of common_factor's iteration from approximate weights w, without the covariance C: with C = a·aᵀ + diag(v),
// C·w − v∘w = a·(aᵀw). Absent where the weighted sum has no power beyond the blocks' own.
std::optional<CommonFactor> next_factor(const Matrix& swings, const VectorXd& weights) {
  const double scale = 1 / static_cast<double>(swings.rows());
  const VectorXd power = swings.colwise().squaredNorm() * scale;
  const VectorXd product = swings.transpose() * (swings * weights) * scale;
  const double floor = min_own_variance(power);
  VectorXd own = VectorXd::Zero(power.size()), loadings = own;
  for (int round = 0; round < kMaxIterations; ++round) {
    loadings = product - own.cwiseProduct(weights);
    const double common = weights.dot(loadings);
    if (!(common > 0)) return std::nullopt;
    loadings /= std::sqrt(common);
    own = (power.array() - loadings.array().square()).max(floor);
  }
  return CommonFactor{{loadings.begin(), loadings.end()}, {own.begin(), own.end()}};
}

// As weighted_rows(), without the dark level. `light`: of each value of a sample, or empty.
template <class Sample, class Stored>
std::vector<double> weighted_samples(const FramesView<const Stored>& view, std::size_t frame,
                                     std::span<const double> weights, std::span<const float> light) {
  DenseRows<Stored, Sample> source(view, frame, light);
  const BlockSize most = source.largest_block({view.rows, view.columns});
  std::vector<double> signal(view.rows), of_part(view.rows);
  for (std::size_t row = 0; row < view.rows; row += most.rows) {
    const std::size_t here = std::min(most.rows, view.rows - row);
    for_each_part(view.columns, most.columns, [&](IndexRange part) {
      kernels::pool_rows(source.read(row, here, part), &weights[part.begin], of_part.data());
      for (std::size_t r = 0; r < here; ++r) signal[row + r] += of_part[r];
    });
  }
  return signal;
}

}  // namespace

std::vector<double> weighted_rows(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                                  std::span<const double> weights) {
  if (curve.kind != ToneCurve::Kind::linear && !holds_integers(frames)) {
    const auto [count, rows, columns] = shape_of(frames);
    const auto signals = column_signals(frames, frame, 0, columns, curve);
    const FramesView<const double> light{signals.data(), 1, rows, columns, 0, 1, static_cast<std::ptrdiff_t>(rows)};
    return weighted_samples<double>(light, 0, weights, {});
  }
  auto signal = std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        if constexpr (std::is_integral_v<T>)
          if (curve.kind != ToneCurve::Kind::linear)
            return weighted_samples<float>(view, frame, weights, light_table(frames, curve)->rounded);
        return weighted_samples<T>(view, frame, weights, {});
      },
      frames);
  if (curve.kind == ToneCurve::Kind::linear) {
    const double dark = curve.dark_level * std::accumulate(weights.begin(), weights.end(), 0.0);
    for (double& light : signal) light -= dark;
  }
  return signal;
}

// Mean light of the blocks that show little of the light combined with these weights of the columns.
static std::vector<double> light_beside(const BlockedFrame& frame, std::span<const double> weights) {
  const std::size_t count = frame.blocks.size();
  VectorXd of_block = VectorXd::Zero(static_cast<Index>(count));
  for (std::size_t block = 0; block < count; ++block)
    for (std::size_t column = frame.blocks[block].begin; column < frame.blocks[block].end; ++column)
      of_block(static_cast<Index>(block)) = std::max(of_block(static_cast<Index>(block)), weights[column]);
  std::vector<double> sorted(of_block.begin(), of_block.end());
  const auto quarter = sorted.begin() + static_cast<std::ptrdiff_t>(kBeside * static_cast<double>(count));
  std::ranges::nth_element(sorted, quarter);
  const double largest = of_block.maxCoeff(), limit = std::max(*quarter, kSmallShare * largest);
  if (!(limit < kMostly * largest)) return {};
  const VectorXd beside = (of_block.array() <= limit).select(frame.sizes.transpose(), 0.0);
  const VectorXd light = frame.means * (beside / beside.sum());
  return {light.begin(), light.end()};
}

CombinedColumn combine_columns(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                               bool use_saturated, std::span<const std::uint8_t> columns) {
  BlockedFrame pixels;
  pixels.fill(frames, frame, curve, use_saturated, columns);
  auto result = combined_from_covariance(pixels);
  result.beside = light_beside(pixels, result.weights);
  if (columns.empty()) result.slope = slope_of(pixels);
  return result;
}

static std::vector<BlockGroup> groups_by(const Matrix& swings, const Eigen::MatrixXd& products) {
  const VectorXd power = swings.colwise().squaredNorm();
  const VectorXd scale = (power.array() > 0).select(power.array().max(1e-300).sqrt().inverse(), 0.0);
  return block_groups(scale.asDiagonal() * products * scale.asDiagonal(), power);
}

ColumnLights column_lights(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve) {
  BlockedFrame pixels;
  pixels.fill(frames, frame, curve, false, {});
  const Eigen::MatrixXd products = gram(pixels.swings.transpose());
  ColumnLights lights{combined_from_products(pixels, products), {}};
  const auto groups = groups_by(pixels.swings, products);
  if (groups.size() < 2) return lights;
  for (const auto& group : groups) {
    LightGroup light{std::vector<std::uint8_t>(pixels.usable.size(), 0), {}};
    VectorXd sum = VectorXd::Zero(pixels.swings.rows());
    for (const Index block : group.members) {
      sum += pixels.swings.col(block);
      const auto at = static_cast<std::size_t>(block);
      for (std::size_t column = pixels.blocks[at].begin; column < pixels.blocks[at].end; ++column)
        light.columns[column] = pixels.usable[column];
    }
    sum.normalize();
    light.swings.assign(sum.begin(), sum.end());
    lights.groups.push_back(std::move(light));
  }
  return lights;
}

std::vector<LightGroup> light_groups(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve) {
  return column_lights(frames, frame, curve).groups;
}

ColumnFollower::ColumnFollower(const ToneCurve& curve) : curve_(curve), memory_(std::make_unique<BlockedFrame>()) {}
ColumnFollower::ColumnFollower(ColumnFollower&&) noexcept = default;
ColumnFollower& ColumnFollower::operator=(ColumnFollower&&) noexcept = default;
ColumnFollower::~ColumnFollower() = default;

void ColumnFollower::forget() {
  weights_.clear();
  slope_ = 0;
  upright_.reset();
}

CombinedColumn ColumnFollower::combine(const AnyFramesView& frame, bool hold) {
  if (upright_) return combine_upright(frame, hold);
  CombinedColumn stored = combine_as_stored(frame, hold);
  if (stored.slope == 0) return stored;
  slope_ = stored.slope;
  upright_ = std::make_unique<ColumnFollower>(curve_);
  return combine_upright(frame, hold);
}

// Where the light of a sheared frame still moves, the frame is sheared again.
CombinedColumn ColumnFollower::combine_upright(const AnyFramesView& frame, bool hold) {
  CombinedColumn result;
  for (int shear = 0; shear < kMaxIterations; ++shear) {
    const UprightFrame upright(frame, 0, slope_);
    result = upright_->combine_as_stored(upright.view(), hold);
    result.weights = upright.own_weights(result.weights);
    const double left = std::exchange(upright_->last_.slope, 0.0);
    if (left == 0) break;
    slope_ += left;
    upright_->forget();
  }
  result.slope = slope_;
  return result;
}

CombinedColumn ColumnFollower::combine_as_stored(const AnyFramesView& frame, bool hold) {
  const bool may_follow = weights_.size() == shape_of(frame).columns;
  BlockedFrame& pixels = *memory_;
  const auto leave_out_streaks = [&](CombinedColumn& result) {
    const VectorXd weights = memory_->sums_of_blocks(weights_);
    has_streaks_ = has_streaks(pixels.means, weights, kStreakRows);
    if (!has_streaks_) return;
    const VectorXd signal = without_streaks(pixels.means, weights);
    result.signal.assign(signal.begin(), signal.end());
  };
  if (may_follow && !moved_ && (hold || ++age_ % kWeightsInterval != 0)) {
    CombinedColumn result = last_;
    result.weights = weights_;
    result.signal = weighted_rows(frame, 0, curve_, weights_);
    if (hold || has_streaks_) {
      pixels.fill(frame, 0, curve_, false, {});
      leave_out_streaks(result);
    }
    return result;
  }
  pixels.fill(frame, 0, curve_, false, {});
  std::optional<CommonFactor> factor;
  if (may_follow && pixels.swings.cols() > 1) factor = next_factor(pixels.swings, memory_->sums_of_blocks(weights_));
  auto result = factor ? combined(pixels, *factor) : combined_from_covariance(pixels);
  if (!factor) age_ = 0;
  result.slope = age_ % kSlopeInterval == 0 || moved_ ? slope_of(pixels) : last_.slope;
  moved_ = false;
  weights_ = result.weights;
  if (hold || has_streaks_ || age_ % kSlopeInterval == 0) leave_out_streaks(result);
  last_ = {{}, {}, result.noise, result.quality, result.slope, result.saturated, {}};
  return result;
}

void ColumnFollower::move(std::ptrdiff_t columns) {
  if (upright_) return upright_->move(columns);
  moved_ = true;
  if (columns > 0)
    std::fill(std::shift_left(weights_.begin(), weights_.end(), columns), weights_.end(), 0.0);
  else
    std::fill(weights_.begin(), std::shift_right(weights_.begin(), weights_.end(), -columns), 0.0);
  const double sum = std::accumulate(weights_.begin(), weights_.end(), 0.0);
  if (!(sum > 0)) return weights_.clear();
  for (double& weight : weights_) weight /= sum;
}

}  // namespace ocisac
