#include "ocisac/tones/projection.hpp"

#include <hwy/targets.h>

#include <Eigen/Core>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numeric>
#include <type_traits>

#include "columns/dense_rows.hpp"
#include "columns/row_kernels.hpp"
#include "core/levels.hpp"
#include "core/parallel.hpp"
#include "light/time_line.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/require.hpp"
#include "tones/projection_kernels.hpp"

namespace ocisac {

namespace {

// Null for no values: there may be no outputs.
auto* from(auto&& values, std::size_t first) { return values.empty() ? nullptr : values.data() + first; }

// Writes a weight into its half of the word of a pair of groups.
void put_weight(std::int32_t& pair, std::size_t group, int weight) {
  const std::uint32_t half = static_cast<std::uint32_t>(weight) & 0xffffU;
  pair = static_cast<std::int32_t>(static_cast<std::uint32_t>(pair) | (group % 2 == 0 ? half : half << 16));
}

Eigen::Map<const Eigen::VectorXd> output_of(std::span<const double> weights, std::size_t output, std::size_t groups) {
  return {weights.data() + output * groups, static_cast<Eigen::Index>(groups)};
}

// Largest integer of a limb that keeps the sums within range; `largest` magnitude of each output's weights.
double largest_integer(std::span<const double> weights, std::span<const double> largest, std::size_t rows,
                       int row_group, int limbs) {
  if (rows > kernels::kRowsPerChunk) return kernels::kMaxWeight;
  const std::size_t whole_groups = rows / static_cast<std::size_t>(row_group);
  const auto groups = static_cast<double>(whole_groups);
  // rounding: up to half a unit per row
  const double room = kernels::kMaxSum / (255.0 * row_group) - 0.5 * groups;
  double integer = kernels::kMaxOfFewRows;
  if (limbs > 1) integer = std::min(integer, room / groups);  // the shape of further limbs is arbitrary
  for (std::size_t o = 0; o < largest.size(); ++o)
    if (largest[o] > 0)
      integer = std::min(integer, room * largest[o] / output_of(weights, o, whole_groups).lpNorm<1>());
  return std::max<double>(std::floor(integer), kernels::kMaxWeight);
}

}  // namespace

RowWeights::RowWeights(std::span<const double> weights, std::size_t outputs, std::size_t rows, int row_group, int limbs)
    : rows_(rows), outputs_(outputs), row_group_(row_group), weights_(weights.begin(), weights.end()) {
  require(row_group == 1 || row_group == 2 || row_group == 4 || row_group == 8, "row_group", row_group, "1, 2, 4 or 8");
  require(limbs >= 1 && limbs <= kMostLimbs, "limbs", limbs, "1, 2 or 3");
  groups_ = rows / static_cast<std::size_t>(row_group);
  require(groups_ > 0, "rows", rows, "at least row_group");
  require(weights.size() == outputs * groups_, "weights", weights.size(), "outputs·(rows/row_group) values");
  for (const double w : weights) require_finite("weights", w);
  std::vector<double> largest;
  for (std::size_t o = 0; o < outputs; ++o) largest.push_back(output_of(weights, o, groups_).lpNorm<Eigen::Infinity>());
  fold_exactly(largest);

  const double integer = largest_integer(weights, largest, rows, row_group, limbs);
  const auto each = static_cast<std::size_t>(limbs);
  units_.resize(outputs * each);
  pairs_.assign(units_.size() * pair_count(), 0);
  for (const std::size_t o : output_order_) {
    const double scale = largest[o] > 0 ? largest[o] / integer : 1.0;
    const std::size_t place = order_.size();
    for (std::size_t limb = 0; limb < each; ++limb) {
      order_.push_back(o * each + limb);
      units_[order_.back()] = scale * std::pow(2 * integer, -static_cast<double>(limb));
    }
    for (std::size_t g = 0; g < groups_; ++g) {
      double rest = weights_[o * groups_ + g] / scale;
      for (std::size_t limb = 0; limb < each; ++limb) {
        const double whole = std::clamp(nearest_whole(rest), -integer, integer);
        rest = (rest - whole) * 2 * integer;
        put_weight(pairs_[(place + limb) * pair_count() + g / 2], g, static_cast<int>(whole));
      }
    }
  }
}

// Weights that are symmetric or antisymmetric but for rounding become so.
void RowWeights::fold_exactly(std::span<const double> largest) {
  output_order_.resize(outputs_);
  std::iota(output_order_.begin(), output_order_.end(), std::size_t{0});
  if (groups_ % 2 == 1 || outputs_ == 0) return;
  const auto deviation = [&](std::size_t o, double sign) {
    const auto row = output_of(weights_, o, groups_);
    return (row - sign * row.reverse()).lpNorm<Eigen::Infinity>();
  };
  std::vector<double> signs;
  for (std::size_t o = 0; o < outputs_; ++o) {
    const double allowed = kEqual * largest[o];
    const bool even = deviation(o, 1) <= allowed;
    if (!even && !(deviation(o, -1) <= allowed)) return;
    signs.push_back(even ? 1 : -1);
  }
  for (std::size_t o = 0; o < outputs_; ++o)
    for (std::size_t g = 0; g < groups_ / 2; ++g)
      weights_[(o + 1) * groups_ - 1 - g] = signs[o] * weights_[o * groups_ + g];
  const auto odd =
      std::stable_partition(output_order_.begin(), output_order_.end(), [&](std::size_t o) { return signs[o] > 0; });
  even_outputs_ = static_cast<std::size_t>(odd - output_order_.begin());
  folds_ = true;
}

// Rounding keeps the symmetry of the exact weights. Folded, the last of an odd number of groups is followed by zeros.
kernels::ByteWeights RowWeights::integers(bool folded, std::size_t group) const {
  return {row_group_, from(pairs_, group / 2), pair_count(), order_, folded ? even_outputs_ * limbs() : order_.size(),
          units_};
}

std::vector<double> RowWeights::byte_weights() const {
  std::vector<double> values(outputs_ * groups_);
  for (std::size_t place = order_.size(); place-- > 0;)  // smallest limb of an output first
    for (std::size_t g = 0; g < groups_; ++g) {
      const auto pair = static_cast<std::uint32_t>(pairs_[place * pair_count() + g / 2]);
      const std::size_t part = order_[place];
      values[part / limbs() * groups_ + g] +=
          units_[part] * static_cast<std::int16_t>(g % 2 == 0 ? pair & 0xffffU : pair >> 16);
    }
  return values;
}

namespace {

using ByteRows = DenseRows<std::uint8_t, std::uint8_t>;

void add_block(ByteRows& near, ByteRows& far, IndexRange columns, std::size_t most_rows, const RowWeights& weights,
               kernels::ProjectionSums sums) {
  const bool folded = weights.folds();
  const auto group = static_cast<std::size_t>(weights.row_group());
  const std::size_t groups = folded ? weights.groups() / 2 : weights.groups();
  const std::size_t most = most_rows / (folded ? 2 * group : group);
  for (std::size_t g = 0; g < groups; g += most) {
    const std::size_t here = std::min(most, groups - g), rows = here * group;
    sums.first = g == 0;
    sums.last = g + here == groups;
    const auto first = near.read(g * group, rows, columns);
    const std::uint8_t* mirrored = nullptr;
    if (folded) {
      const auto last = far.read((weights.groups() - g - here) * group, rows, columns);
      mirrored = last.samples + static_cast<std::ptrdiff_t>(rows - group) * last.stride;
    }
    kernels::project_bytes({first.samples, mirrored, first.stride, here, columns.size(), !near.in_place(),
                            here == groups ? near.to_next_frame() : 0},
                           weights.integers(folded, g), sums);
  }
}

// Resizes without initialisation.
void make_room(std::size_t outputs, std::size_t count, Projection& result) {
  result.sums.resize(outputs * count);
  for (std::vector<double>* moments : {&result.totals, &result.squares, &result.maximum}) moments->resize(count);
}

void clear(std::size_t outputs, std::size_t count, Projection& result) {
  result.sums.assign(outputs * count, 0.0);
  for (std::vector<double>* moments : {&result.totals, &result.squares}) moments->assign(count, 0.0);
  result.maximum.assign(count, -std::numeric_limits<double>::infinity());
}

// Accumulators from column `first` of `count` on.
kernels::ProjectionSums sums_of(Projection& result, std::size_t first, std::size_t count) {
  return {from(result.sums, first), count, result.totals.data() + first, result.squares.data() + first,
          result.maximum.data() + first};
}

// Adds the parts of each output, in place, smallest limb first.
void join_limbs(const RowWeights& weights, std::size_t count, std::vector<double>& sums) {
  const std::size_t limbs = weights.limbs();
  if (limbs == 1) return;
  for (std::size_t o = 0; o < weights.outputs(); ++o)
    for (std::size_t c = 0; c < count; ++c) {
      double sum = 0;
      for (std::size_t part = (o + 1) * limbs; part-- > o * limbs;) sum += sums[part * count + c];
      sums[o * count + c] = sum;
    }
  sums.resize(weights.outputs() * count);
}

void add_by_rows(const FramesView<const std::uint8_t>& view, std::size_t frame, const RowWeights& weights,
                 Projection& result) {
  ByteRows near(view, frame, {}), far(view, frame, {});
  const BlockSize most = near.largest_block({kernels::kRowsPerChunk, view.columns});
  for_each_part(view.columns, most.columns, [&](IndexRange part) {
    add_block(near, far, part, most.rows, weights, sums_of(result, part.begin, view.columns));
  });
}

// Rows across, straight from the frame: with few outputs faster than transposed, where outputs take half as long.
constexpr std::size_t kMostAcross = 8;

bool is_projected_across(const FramesView<const std::uint8_t>& view, const RowWeights& weights) {
  return view.row_stride == 1 && view.column_stride != 1 && view.rows >= kernels::kFewestAcross &&
         weights.row_group() == 1 && weights.outputs() * weights.limbs() <= kMostAcross;
}

void add_across(const FramesView<const std::uint8_t>& view, std::size_t frame, const RowWeights& weights,
                kernels::ProjectionSums sums) {
  for (std::size_t row = 0; row < view.rows; row += kernels::kRowsPerChunk) {
    const std::size_t here = std::min(kernels::kRowsPerChunk, view.rows - row);
    sums.first = row == 0;
    sums.last = row + here == view.rows;
    kernels::project_across({view.at(frame, row, 0), nullptr, view.column_stride, here, view.columns},
                            weights.integers(false, row), sums);
  }
}

template <class Sample, class Stored>
void project_samples(const FramesView<const Stored>& view, std::size_t frame, const RowWeights& weights,
                     std::span<const float> light, Projection& result) {
  const auto group = static_cast<std::size_t>(weights.row_group());
  clear(weights.outputs(), view.columns, result);
  std::vector<double> light_of_bytes;
  if constexpr (std::is_same_v<Sample, std::uint8_t>) light_of_bytes.assign(light.begin(), light.end());
  DenseRows<Stored, Sample> near(view, frame, light), far(view, frame, light);
  const bool more = weights.outputs() > 2, tone = weights.outputs() == 2 && weights.even_outputs() == 1;
  // In place, samples of eight bytes and narrow vectors are read in one stream: two cost more than they save.
  const bool in_two_streams = !near.in_place() || (kernels::has_wide_vectors() && sizeof(Stored) < sizeof(double));
  const bool folded = weights.folds() && (more || (tone && in_two_streams));
  const std::size_t groups = folded ? weights.groups() / 2 : weights.groups();
  const std::size_t most = kernels::kSampleRows / (folded ? 2 * group : group);
  const std::size_t most_columns = near.in_place() ? view.columns : kCopied.columns;
  for (std::size_t g = 0; g < groups; g += most) {
    const std::size_t here = std::min(most, groups - g), read = here * group;
    const auto next_rows = static_cast<std::ptrdiff_t>(read) * view.row_stride;
    for_each_part(view.columns, most_columns, [&](IndexRange part) {
      const bool last = part.end == view.columns;
      const auto to_next = [&](std::ptrdiff_t next) {
        return last ? next - static_cast<std::ptrdiff_t>(part.begin) * view.column_stride
                    : static_cast<std::ptrdiff_t>(part.size());
      };
      const auto rows = near.read(g * group, read, part, to_next(next_rows));
      const Sample* mirrored = nullptr;
      if (folded) {
        const auto others = far.read((weights.groups() - g - here) * group, read, part, to_next(-next_rows));
        mirrored = others.samples + static_cast<std::ptrdiff_t>(read - group) * others.stride;
      }
      const kernels::SampleBlock<Sample> block{
          rows.samples,         mirrored, rows.stride, here, part.size(), near.in_place() ? to_next(next_rows) : 0,
          light_of_bytes.data()};
      kernels::project_samples(block,
                               {weights.row_group(), from(weights.weights(), g), weights.groups(),
                                weights.output_order(), weights.even_outputs()},
                               sums_of(result, part.begin, view.columns));
    });
  }
}

// True if a frame of interleaved bytes is read with all that lies between its columns: with wide vectors and a tone,
// sums that nobody asks for take less time than a copy without them.
bool is_read_whole(const FramesView<const std::uint8_t>& view, const RowWeights& weights) {
  return view.column_stride > 1 && view.column_stride <= 4 && weights.outputs() * weights.limbs() <= 2 &&
         kernels::has_wide_vectors();
}

void keep_every(std::size_t step, std::size_t count, std::vector<double>& values) {
  const std::size_t whole = (count - 1) * step + 1, rows = values.size() / whole;
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t c = 0; c < count; ++c) values[i * count + c] = values[i * whole + c * step];
  values.resize(rows * count);
}

void project_bytes(const FramesView<const std::uint8_t>& view, std::size_t frame, const RowWeights& weights,
                   Projection& result) {
  if (kernels::target() == HWY_SCALAR) {
    std::vector<float> values(std::numeric_limits<std::uint8_t>::max() + 1);
    std::iota(values.begin(), values.end(), 0.0F);
    return project_samples<float>(view, frame,
                                  {weights.byte_weights(), weights.outputs(), weights.rows(), weights.row_group(), 1},
                                  values, result);
  }
  if (is_read_whole(view, weights)) {
    const auto step = static_cast<std::size_t>(view.column_stride);
    FramesView<const std::uint8_t> whole = view;
    whole.columns = (view.columns - 1) * step + 1;
    whole.column_stride = 1;
    project_bytes(whole, frame, weights, result);
    for (auto* values : {&result.sums, &result.totals, &result.squares, &result.maximum})
      keep_every(step, view.columns, *values);
    return;
  }
  make_room(weights.outputs() * weights.limbs(), view.columns, result);
  if (is_projected_across(view, weights))
    add_across(view, frame, weights, sums_of(result, 0, view.columns));
  else
    add_by_rows(view, frame, weights, result);
  join_limbs(weights, view.columns, result.sums);
}

template <class T>
void check_light(std::span<const float> light) {
  if constexpr (std::is_integral_v<T>)
    require(light.empty() || light.size() == std::size_t{std::numeric_limits<T>::max()} + 1, "light", light.size(),
            "none, or one of each value of a sample");
  else
    require(light.empty(), "light", light.size(), "none for floating-point samples");
}

void check(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
           const RowWeights& weights, std::span<const float> light) {
  std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        require(view.rows == weights.rows(), "rows", view.rows, "as many as the weights were made for");
        require(frame < view.frames, "frame", frame, "below the number of frames");
        require(count > 0 && first < view.columns && count <= view.columns - first, "count", count,
                "columns inside the frame");
        check_light<T>(light);
      },
      frames);
}

}  // namespace

void project(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
             const RowWeights& weights, std::span<const float> light, Projection& result) {
  check(frames, frame, first, count, weights, light);
  std::visit(
      [&]<class T>(FramesView<const T> view) {
        view.data = view.at(0, 0, first);
        view.columns = count;
        if constexpr (std::is_same_v<T, std::uint8_t>)
          if (!light.empty() && kernels::takes_light_of_bytes())
            return project_samples<T>(view, frame, weights, light, result);
        if constexpr (std::is_integral_v<T>)
          if (!light.empty()) return project_samples<float>(view, frame, weights, light, result);
        if constexpr (std::is_same_v<T, std::uint8_t>)
          project_bytes(view, frame, weights, result);
        else
          project_samples<T>(view, frame, weights, {}, result);
      },
      frames);
}

Projection project(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
                   const RowWeights& weights, std::span<const float> light) {
  Projection result;
  project(frames, frame, first, count, weights, light, result);
  return result;
}

std::uint64_t read_bytes(std::span<const std::uint8_t> bytes, int threads) {
  constexpr std::size_t kPerBlock = 1 << 19;
  std::atomic<std::uint64_t> sum = 0;
  for_each_block((bytes.size() + kPerBlock - 1) / kPerBlock, threads, [&](std::size_t block) {
    const auto part = bytes.subspan(block * kPerBlock);
    sum += kernels::read_bytes(part.data(), std::min(part.size(), kPerBlock));
  });
  return sum;
}

std::vector<std::string> simd_targets() {
  std::vector<std::string> names;
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) names.emplace_back(hwy::TargetName(target));
  return names;
}

std::string simd_target() { return hwy::TargetName(kernels::target()); }

void force_simd_target(const std::string& name) {
  hwy::SetSupportedTargetsForTest(0);
  std::int64_t chosen = 0;  // the best
  if (!name.empty()) {
    std::string known;
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      const std::string own = hwy::TargetName(target);
      if (name == own) chosen = target;
      known += (known.empty() ? "" : ", ") + own;
    }
    require(chosen != 0, "target", name, known);
  }
  hwy::SetSupportedTargetsForTest(chosen);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

}  // namespace ocisac
