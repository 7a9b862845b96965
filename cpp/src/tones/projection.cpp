#include "ocisac/tones/projection.hpp"

#include <hwy/targets.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <type_traits>

#include "ocisac/core/require.hpp"
#include "tones/projection_kernels.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kStagedRows = 16;  // a multiple of every row group

// Writes a weight into its half of the word of a pair of groups.
void put_weight(std::int32_t& pair, std::size_t group, int weight) {
  const std::uint32_t half = static_cast<std::uint32_t>(weight) & 0xffffU;
  pair = static_cast<std::int32_t>(static_cast<std::uint32_t>(pair) | (group % 2 == 0 ? half : half << 16));
}

// Magnitudes of an output's weights.
struct Magnitudes {
  double sum, largest;
};

Magnitudes magnitudes(std::span<const double> weights) {
  Magnitudes found{};
  for (const double weight : weights) {
    found.sum += std::abs(weight);
    found.largest = std::max(found.largest, std::abs(weight));
  }
  return found;
}

// Largest integer of a limb that keeps the sums within range.
double largest_integer(const std::vector<Magnitudes>& outputs, std::size_t rows, int row_group, int limbs) {
  if (rows > kernels::kRowsPerChunk) return kernels::kMaxWeight;
  const std::size_t whole_groups = rows / static_cast<std::size_t>(row_group);
  const auto groups = static_cast<double>(whole_groups);
  // rounding: up to half a unit per row
  const double room = kernels::kMaxSum / (255.0 * row_group) - 0.5 * groups;
  double largest = kernels::kMaxOfFewRows;
  if (limbs > 1) largest = std::min(largest, room / groups);  // the shape of further limbs is arbitrary
  for (const Magnitudes& of : outputs)
    if (of.sum > 0) largest = std::min(largest, room * of.largest / of.sum);
  return std::max<double>(std::floor(largest), kernels::kMaxWeight);
}

}  // namespace

RowWeights::RowWeights(std::span<const double> weights, std::size_t outputs, std::size_t rows, int row_group, int limbs)
    : rows_(rows), outputs_(outputs), row_group_(row_group), weights_(weights.begin(), weights.end()) {
  require(row_group == 1 || row_group == 2 || row_group == 4 || row_group == 8, "row_group", row_group, "1, 2, 4 or 8");
  require(limbs >= 1 && limbs <= 3, "limbs", limbs, "1, 2 or 3");
  groups_ = rows / static_cast<std::size_t>(row_group);
  require(groups_ > 0, "rows", rows, "at least row_group");
  require(weights.size() == outputs * groups_, "weights", weights.size(), "outputs·(rows/row_group) values");
  for (const double w : weights) require_finite("weights", w);

  std::vector<Magnitudes> of_outputs;
  for (std::size_t o = 0; o < outputs; ++o) of_outputs.push_back(magnitudes(weights.subspan(o * groups_, groups_)));
  const double integer = largest_integer(of_outputs, rows, row_group, limbs);
  pairs_.assign(outputs * static_cast<std::size_t>(limbs) * pair_count(), 0);
  for (std::size_t o = 0; o < outputs; ++o) {
    const double scale = of_outputs[o].largest > 0 ? of_outputs[o].largest / integer : 1.0;
    const std::size_t first = units_.size();
    for (int limb = 0; limb < limbs; ++limb) units_.push_back(scale * std::pow(2 * integer, -limb));
    for (std::size_t g = 0; g < groups_; ++g) {
      double rest = weights_[o * groups_ + g] / scale;
      for (std::size_t part = first; part < units_.size(); ++part) {
        const double whole = std::clamp(std::nearbyint(rest), -integer, integer);
        rest = (rest - whole) * 2 * integer;
        put_weight(pairs_[part * pair_count() + g / 2], g, static_cast<int>(whole));
      }
    }
  }
  fold();
}

int RowWeights::integer_weight(std::size_t part, std::size_t group) const {
  const auto pair = static_cast<std::uint32_t>(pairs_[part * pair_count() + group / 2]);
  return static_cast<std::int16_t>(group % 2 == 0 ? pair & 0xffffU : pair >> 16);
}

bool RowWeights::has_symmetry(std::size_t part, int sign) const {
  for (std::size_t g = 0; g < groups_ / 2; ++g)
    if (integer_weight(part, g) != sign * integer_weight(part, groups_ - 1 - g)) return false;
  return true;
}

void RowWeights::fold() {
  order_.resize(units_.size());
  std::iota(order_.begin(), order_.end(), std::size_t{0});
  if (groups_ % 2 == 1) return;
  std::vector<std::size_t> order;
  for (const std::size_t part : order_)
    if (has_symmetry(part, 1)) order.push_back(part);
  const std::size_t even = order.size();
  for (const std::size_t part : order_)
    if (!has_symmetry(part, 1) && has_symmetry(part, -1)) order.push_back(part);
  if (order.size() < order_.size()) return;
  even_parts_ = even;
  folded_pairs_.assign(order.size() * folded_pair_count(), 0);
  for (std::size_t place = 0; place < order.size(); ++place) {
    for (std::size_t g = 0; g < groups_ / 2; ++g)
      put_weight(folded_pairs_[place * folded_pair_count() + g / 2], g, integer_weight(order[place], g));
  }
  folded_order_ = std::move(order);
}

std::vector<double> RowWeights::byte_weights() const {
  std::vector<double> values(outputs_ * groups_);
  const std::size_t limbs = units_.size() / outputs_;
  for (std::size_t part = units_.size(); part-- > 0;)  // smallest limb of an output first
    for (std::size_t g = 0; g < groups_; ++g)
      values[part / limbs * groups_ + g] += units_[part] * integer_weight(part, g);
  return values;
}

namespace {

// Visits blocks of whole row groups with dense rows: the frame's own memory, or a copy if its columns are strided.
template <class T, class Visit>
void for_each_dense_block(const FramesView<const T>& view, std::size_t frame, std::size_t first, std::size_t count,
                          std::size_t rows, std::size_t largest_block, Visit visit) {
  if (view.column_stride == 1 || count == 1) {
    for (std::size_t row = 0; row < rows; row += largest_block)
      visit(view.at(frame, row, first), view.row_stride, row, std::min(largest_block, rows - row));
    return;
  }
  std::vector<T> dense(kStagedRows * count);
  for (std::size_t row = 0; row < rows; row += kStagedRows) {
    const std::size_t here = std::min(kStagedRows, rows - row);
    for (std::size_t r = 0; r < here; ++r)
      for (std::size_t c = 0; c < count; ++c) dense[r * count + c] = view(frame, row + r, first + c);
    visit(dense.data(), static_cast<std::ptrdiff_t>(count), row, here);
  }
}

void add_folded(const FramesView<const std::uint8_t>& view, std::size_t frame, std::size_t first, std::size_t count,
                const RowWeights& weights, kernels::ProjectionSums sums) {
  const auto group = static_cast<std::size_t>(weights.row_group());
  const std::size_t half = weights.groups() / 2;
  const std::size_t most = kernels::kRowsPerChunk / (2 * group);
  for (std::size_t g = 0; g < half; g += most) {
    sums.first = g == 0;
    kernels::project_bytes({view.at(frame, g * group, first), view.at(frame, (weights.groups() - 1 - g) * group, first),
                            view.row_stride, std::min(most, half - g), count},
                           {weights.row_group(), weights.folded_pairs().data() + g / 2, weights.folded_pair_count(),
                            weights.folded_order(), weights.even_parts()},
                           sums);
  }
}

void add_plainly(const FramesView<const std::uint8_t>& view, std::size_t frame, std::size_t first, std::size_t count,
                 const RowWeights& weights, kernels::ProjectionSums sums) {
  const auto group = static_cast<std::size_t>(weights.row_group());
  for_each_dense_block(view, frame, first, count, weights.groups() * group, kernels::kRowsPerChunk,
                       [&](const std::uint8_t* pixels, std::ptrdiff_t stride, std::size_t row, std::size_t rows) {
                         sums.first = row == 0;
                         kernels::project_bytes({pixels, nullptr, stride, rows / group, count},
                                                {weights.row_group(), weights.pairs().data() + row / (2 * group),
                                                 weights.pair_count(), weights.order(), weights.order().size()},
                                                sums);
                       });
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

kernels::ProjectionSums sums_of(Projection& result) {
  return {result.sums.data(), {result.totals.data(), result.squares.data(), result.maximum.data()}};
}

// Combines the exact integer sums of parts into those of outputs, in place; smallest limb first.
void join_limbs(const RowWeights& weights, std::size_t count, std::vector<double>& sums) {
  const std::span units = weights.units();
  const std::size_t limbs = units.size() / weights.outputs();
  for (std::size_t o = 0; o < weights.outputs(); ++o) {
    const std::span<double> joined = std::span(sums).subspan(o * count, count);
    if (limbs == 1) {
      const double unit = units[o];
      for (double& sum : joined) sum *= unit;
      continue;
    }
    for (std::size_t c = 0; c < count; ++c) {
      double sum = 0;
      for (std::size_t part = (o + 1) * limbs; part-- > o * limbs;) sum += units[part] * sums[part * count + c];
      joined[c] = sum;
    }
  }
  sums.resize(weights.outputs() * count);
}

void project_bytes(const FramesView<const std::uint8_t>& view, std::size_t frame, std::size_t first, std::size_t count,
                   const RowWeights& weights, Projection& result) {
  make_room(weights.units().size(), count, result);
  if (!weights.folded_pairs().empty() && (view.column_stride == 1 || count == 1))
    add_folded(view, frame, first, count, weights, sums_of(result));
  else
    add_plainly(view, frame, first, count, weights, sums_of(result));
  join_limbs(weights, count, result.sums);
}

template <class T>
void project_samples(const FramesView<const T>& view, std::size_t frame, std::size_t first, std::size_t count,
                     const RowWeights& weights, Projection& result) {
  const auto group = static_cast<std::size_t>(weights.row_group());
  clear(weights.outputs(), count, result);
  for_each_dense_block(view, frame, first, count, weights.groups() * group, weights.groups() * group,
                       [&](const T* pixels, std::ptrdiff_t stride, std::size_t row, std::size_t rows) {
                         kernels::project_samples<T>({pixels, stride, rows / group, count},
                                                     {weights.row_group(), weights.weights().data() + row / group,
                                                      weights.groups(), weights.outputs()},
                                                     sums_of(result));
                       });
}

void check(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
           const RowWeights& weights) {
  std::visit(
      [&](const auto& view) {
        require(view.rows == weights.rows(), "rows", view.rows, "as many as the weights were made for");
        require(frame < view.frames, "frame", frame, "below the number of frames");
        require(count > 0 && first < view.columns && count <= view.columns - first, "count", count,
                "columns inside the frame");
      },
      frames);
}

}  // namespace

void project(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
             const RowWeights& weights, Projection& result) {
  check(frames, frame, first, count, weights);
  std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        if constexpr (std::is_same_v<T, std::uint8_t>)
          project_bytes(view, frame, first, count, weights, result);
        else
          project_samples(view, frame, first, count, weights, result);
      },
      frames);
}

Projection project(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
                   const RowWeights& weights) {
  Projection result;
  project(frames, frame, first, count, weights, result);
  return result;
}

Projection project_plainly(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
                           const RowWeights& weights) {
  check(frames, frame, first, count, weights);
  const auto group = static_cast<std::size_t>(weights.row_group());
  return std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        const bool bytes = std::is_same_v<T, std::uint8_t>;
        const auto used =
            bytes ? weights.byte_weights() : std::vector<double>(weights.weights().begin(), weights.weights().end());
        Projection result;
        clear(weights.outputs(), count, result);
        for (std::size_t c = 0; c < count; ++c)
          for (std::size_t g = 0; g < weights.groups(); ++g) {
            double sum = 0;
            for (std::size_t r = g * group; r < (g + 1) * group; ++r) {
              const auto v = static_cast<double>(view(frame, r, first + c));
              result.maximum[c] = std::max(result.maximum[c], v);
              sum += v;
            }
            result.totals[c] += sum;
            result.squares[c] += sum * sum;
            for (std::size_t o = 0; o < weights.outputs(); ++o)
              result.sums[o * count + c] += used[o * weights.groups() + g] * sum;
          }
        return result;
      },
      frames);
}

std::vector<std::string> simd_targets() {
  std::vector<std::string> names;
  for (const auto targets = hwy::SupportedAndGeneratedTargets(); const std::int64_t target : targets)
    names.emplace_back(hwy::TargetName(target));
  return names;
}

std::string simd_target() { return kernels::target_name(); }

void force_simd_target(const std::string& name) {
  hwy::SetSupportedTargetsForTest(0);
  if (!name.empty()) {
    std::int64_t chosen = 0;
    std::string known;
    for (const auto targets = hwy::SupportedAndGeneratedTargets(); const std::int64_t target : targets) {
      if (name == hwy::TargetName(target)) chosen = target;
      known += (known.empty() ? "" : ", ") + std::string(hwy::TargetName(target));
    }
    require(chosen != 0, "target", name, known);
    hwy::SetSupportedTargetsForTest(chosen);
  }
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

}  // namespace ocisac
