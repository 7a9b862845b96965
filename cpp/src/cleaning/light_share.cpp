#include "ocisac/cleaning/light_share.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <type_traits>
#include <utility>

#include "cleaning/cleaned_picture.hpp"
#include "cleaning/merged_blocks.hpp"
#include "core/check_interrupt.hpp"
#include "core/statistics.hpp"

namespace ocisac {

namespace {

using Eigen::ArrayXd;
using Eigen::Index;

constexpr std::array<double, 3> kWideReaches{48, 32, 32}, kReaches{24, 16, 8};  // of the steps, pixels
// Relative change of light that halves the passage weight, per row of the lag: a larger lag gives fewer comparisons,
// which need a wider reach. Between frames the lag does not matter.
constexpr double kEdgeOfLag = 0.025, kEdgeOfFrames = 0.15;
constexpr double kHold = 1000;      // weight of the previous step's share
constexpr double kLagsOfReach = 2;  // at least
constexpr double kEdgeNoise = 9;    // in variances: suppresses edges caused by noise

constexpr std::size_t kMergedAtFirst = 4;  // columns per sum in the wide steps

// Increase of the log-likelihood of a pair of pixels: pictures under an even light have at most 0.03.
constexpr double kGainByChance = 0.05;

constexpr double kVariation = 20;  // λ, in log likelihood: equals the evidence of 10 pixels for a change of 1 in share
constexpr int kSteps = 4;          // of reweighting
constexpr double kRegular = 1e-3;  // ε per pixel; the weight of a pixel without evidence
constexpr std::array<int, 4> kIterations{4, 12, 20, 40};  // per level, from the finest; last value for the coarsest
constexpr Index kMinSide = 8;                             // of a level that is reduced further

constexpr std::size_t kTogether = 8;  // rows: independent chains hide the latency of the products

// Evidence of a picture, cleaned with the current shares, for a change of them, (rows × columns).
struct ShareEvidence {
  std::vector<double> pull;    // Σ weight·residual·slope
  std::vector<double> weight;  // Σ weight·slope²
};

// Comparison of two pixels of equal texture: weight of the pair and its contribution to the gradient in q.
struct Comparison {
  double pull, weight;
};

inline Comparison compare(double c1, double g1, double var1, double c2, double g2, double var2, double texture) {
  const double difference = c2 - c1, mean = std::max(0.5 * (c2 + c1), 0.0), slope = g2 - g1;
  const double spread = texture * texture * mean * mean + difference * difference + (var1 + var2);
  const double common = mean * slope / spread;  // 0 where there is no light; no branch around the division: vectors
  return {common * difference, common * mean * slope};
}

void compare_rows(const Cleaned& frame, std::size_t columns, std::size_t first, std::size_t second, double texture,
                  ShareEvidence& evidence) {
  const double* const light = frame.light.data();
  const double* const slope = frame.slope.data();
  const double* const variance = frame.variance.data();
  const std::size_t a = first * columns, b = second * columns;
  double* __restrict pull_a = &evidence.pull[a];
  double* __restrict pull_b = &evidence.pull[b];
  double* __restrict weight_a = &evidence.weight[a];
  double* __restrict weight_b = &evidence.weight[b];
  for (std::size_t k = 0; k < columns; ++k) {
    const Comparison both =
        compare(light[a + k], slope[a + k], variance[a + k], light[b + k], slope[b + k], variance[b + k], texture);
    pull_a[k] += 0.5 * both.pull;
    pull_b[k] += 0.5 * both.pull;
    weight_a[k] += 0.5 * both.weight;
    weight_b[k] += 0.5 * both.weight;
  }
}

void compare_frames(const Cleaned& one, const Cleaned& next, double texture, ShareEvidence& evidence) {
  for (std::size_t i = 0; i < evidence.pull.size(); ++i) {
    const Comparison both =
        compare(one.light[i], one.slope[i], one.variance[i], next.light[i], next.slope[i], next.variance[i], texture);
    evidence.pull[i] += both.pull;
    evidence.weight[i] += both.weight;
  }
}

// Sums of the cleaned frames with weights 1/variance; `slope` is not used.
void add_to_guide(const Cleaned& frame, std::size_t first, std::size_t end, Cleaned& sums) {
  for (std::size_t i = first; i < end; ++i) {
    const double certainty = 1 / frame.variance[i];
    sums.light[i] += certainty * frame.light[i];
    sums.variance[i] += certainty;
  }
}

void finish_guide(Cleaned& sums) {  // from sums to means
  for (std::size_t i = 0; i < sums.light.size(); ++i) {
    sums.light[i] = sums.variance[i] > 0 ? sums.light[i] / sums.variance[i] : 0;
    sums.variance[i] = 1 / sums.variance[i];
  }
}

// Weight in [0, 1] with which the evidence of a pixel applies to the pixel `apart` further on.
void passages(const Cleaned& guide, std::size_t apart, double reach, double edge, std::vector<double>& out) {
  const double decay = std::exp(-1 / reach);
  const std::size_t count = out.size() - std::min(apart, out.size());
  const double* const light = guide.light.data();
  const double* const variance = guide.variance.data();
  double* __restrict weight = out.data();
  for (std::size_t a = 0; a < count; ++a) {
    const double difference = light[a + apart] - light[a];
    const double mean = 0.5 * (light[a + apart] + light[a]);
    const double noise = kEdgeNoise * (variance[a + apart] + variance[a]);
    weight[a] = decay / (1 + difference * difference / (edge * edge * mean * mean + noise));
  }
}

// Both directions along neighbouring lines of `length` pixels, `apart` each from the next; the lines are `beside`.
// `sum`: zeros, one a line.
template <class Apart, class Beside, class Sum>
void sum_both_ways(const double* passage, double* values, std::size_t length, Apart apart, Beside beside, Sum sum) {
  const std::size_t lines = sum.size();
  std::vector<double> back(length * lines);  // from beyond, without the pixel itself
  for (std::size_t k = length; k-- > 0;)
    for (std::size_t line = 0; line < lines; ++line) {
      const std::size_t i = k * apart + line * beside;
      back[k * lines + line] = sum[line];
      if (k > 0) sum[line] = passage[i - apart] * (values[i] + sum[line]);
    }
  std::ranges::fill(sum, 0.0);
  for (std::size_t k = 0; k < length; ++k)
    for (std::size_t line = 0; line < lines; ++line) {
      const std::size_t i = k * apart + line * beside;
      const double here = values[i] + sum[line];
      values[i] = here + back[k * lines + line];
      sum[line] = passage[i] * here;
    }
}

using One = std::integral_constant<std::size_t, 1>;

// Sums over the surroundings of every pixel that end at edges: a recursive edge-aware filter (cf. Gastal and Oliveira
// 2011, domain transform). Each value becomes the sum of those of its line, weighted with the product of the passages
// on the way. `down`, `across`: (rows × columns), passage from each pixel to the next row and column; the last ones are
// not used.
void sum_along_columns(const std::vector<double>& down, std::size_t columns, std::vector<double>& values) {
  sum_both_ways(down.data(), values.data(), values.size() / columns, columns, One{}, std::vector<double>(columns));
}

void sum_along_rows(const std::vector<double>& across, std::size_t columns, std::vector<double>& values) {
  const std::size_t rows = values.size() / columns;
  const auto sum_rows = [&](std::size_t row, auto sum) {
    sum_both_ways(&across[row * columns], &values[row * columns], columns, One{}, columns, std::move(sum));
  };
  std::size_t row = 0;
  for (; row + kTogether <= rows; row += kTogether) sum_rows(row, std::array<double, kTogether>{});
  if (row < rows) sum_rows(row, std::vector<double>(rows - row));
}

// Adds Σ_j coupling·(x_i − x_j) over the neighbours `apart` further on and before; no coupling leaves a row.
void add_flow(const ArrayXd& coupling, Index apart, const ArrayXd& x, ArrayXd& out) {
  const Index count = x.size() - apart;
  const ArrayXd flow = coupling.head(count) * (x.head(count) - x.tail(count));
  out.head(count) += flow;
  out.tail(count) -= flow;
}

// System: weight·x_i + Σ_j coupling_ij·(x_i − x_j) = right over the neighbours j.
struct Level {
  Index rows, columns;
  ArrayXd weight, down, across;  // couplings to the next row and column, 0 where there is none
  ArrayXd right;                 // right-hand side, then the residual
  ArrayXd change;                // x
  ArrayXd direction, product;

  Level(Index rows_of, Index columns_of) : rows(rows_of), columns(columns_of) {
    for (auto* values : {&weight, &down, &across, &right, &change, &direction, &product})
      values->setZero(rows * columns);
  }

  // Sums over 2 × 2 pixels.
  void take_from(const Level& finer) {
    for (auto* values : {&weight, &down, &across, &right}) values->setZero();
    for (Index row = 0; row < finer.rows; ++row)
      for (Index column = 0; column < finer.columns; ++column) {
        const Index from = row * finer.columns + column, to = row / 2 * columns + column / 2;
        weight[to] += finer.weight[from];
        right[to] += finer.right[from];
        if (row % 2 == 1) down[to] += finer.down[from];
        if (column % 2 == 1) across[to] += finer.across[from];
      }
  }

  // Start value: the change of the coarser pixel.
  void start_from(const Level& coarser) {
    for (Index row = 0; row < rows; ++row)
      for (Index column = 0; column < columns; ++column)
        change[row * columns + column] = coarser.change[row / 2 * coarser.columns + column / 2];
  }

  void apply(const ArrayXd& x, ArrayXd& out) const {
    out = weight * x;
    add_flow(across, 1, x, out);
    add_flow(down, columns, x, out);
  }

  void solve(int count) {
    ArrayXd inverse = weight + down + across;  // of the diagonal
    inverse.tail(inverse.size() - columns) += down.head(inverse.size() - columns);
    inverse.tail(inverse.size() - 1) += across.head(inverse.size() - 1);
    inverse = inverse.inverse();
    apply(change, product);
    right -= product;
    direction.setZero();
    double residual = (right.square() * inverse).sum(), keep = 0;
    const double negligible = 1e-24 * residual;
    for (int k = 0; k < count && residual > negligible; ++k) {
      check_interrupt();
      direction = right * inverse + keep * direction;
      apply(direction, product);
      const double step = residual / (direction * product).sum();
      change += step * direction;
      right -= step * product;
      const double before = std::exchange(residual, (right.square() * inverse).sum());
      keep = residual / before;
    }
  }
};

// Couplings of the finest level: the share's slope has little weight where it is large.
void couple(const ArrayXd& share, Level& level) {
  const Index columns = level.columns;
  ArrayXd slope = ArrayXd::Zero(share.size());  // squared: twice the mean of both sides
  const auto visit = [&](auto of_pair) {
    for (Index i = 0; i < share.size(); ++i) {
      if ((i + 1) % columns != 0) of_pair(i, i + 1, level.across);
      if (i + columns < share.size()) of_pair(i, i + columns, level.down);
    }
  };
  visit([&](Index i, Index next, const ArrayXd&) {
    const double difference = share[next] - share[i];
    slope[i] += difference * difference;
    slope[next] += difference * difference;
  });
  visit([&](Index i, Index next, ArrayXd& coupling) {
    coupling[i] = kVariation / std::sqrt(kRegular * kRegular + 0.25 * (slope[i] + slope[next]));
  });
}

// Reduces ½·Σ weight·x² − Σ pull·x + λ·Σ √(ε² + |∇(q + x)|²) over changes x of the shares q by one step of iteratively
// reweighted least squares: their total variation, in which edges cost little, since most edges of the picture are
// edges of the objects, not of the light. Conjugate gradients solve its equations from coarse to fine, on the picture
// reduced 8, 4 and 2 times and then on its pixels; the finest level comes first.
void reduce_variation(const ShareEvidence& evidence, std::vector<Level>& levels, Eigen::Map<ArrayXd> share) {
  Level& finest = levels.front();
  const auto array_of = [](const std::vector<double>& values) {
    return Eigen::Map<const ArrayXd>(values.data(), static_cast<Index>(values.size()));
  };
  couple(share, finest);
  finest.weight.setZero();
  finest.apply(share, finest.product);
  finest.right = array_of(evidence.pull) - finest.product;
  finest.weight = array_of(evidence.weight) + kRegular;
  for (std::size_t k = 1; k < levels.size(); ++k) levels[k].take_from(levels[k - 1]);
  levels.back().change.setZero();
  for (std::size_t k = levels.size(); k-- > 0;) {
    if (k + 1 < levels.size()) levels[k].start_from(levels[k + 1]);
    levels[k].solve(k + 1 < levels.size() ? kIterations[k] : kIterations.back());
  }
  share += finest.change;
}

class ShareEstimator {
 public:
  // `merged`: number of columns of the picture per column of this one.
  ShareEstimator(const BandedPicture& picture, std::span<const double> row_light, std::size_t merged = 1)
      : picture_(picture),
        merged_(static_cast<double>(merged)),
        change_(row_light.begin(), row_light.end()),
        lag_(comparison_lag(row_light, picture.rows)),
        edge_(picture.frames > 1 ? kEdgeOfFrames : kEdgeOfLag * static_cast<double>(lag_)),
        pixels_(picture.rows * picture.columns),
        evidence_{std::vector<double>(pixels_), std::vector<double>(pixels_)},
        now_(pixels_),
        before_(picture.frames > 1 ? pixels_ : 0),
        guide_(pixels_),
        down_(pixels_),
        across_(pixels_) {
    for (double& value : change_) value -= 1;
    const double darkest = -*std::min_element(change_.begin(), change_.end());
    max_share_ = 1 / std::max(darkest, 1e-9);
  }

  std::vector<double> estimate(std::span<const double> row_light, bool smooth) {
    if (smooth)
      take_wide_steps(row_light);
    else
      wide_steps();
    for (std::size_t k = 0; k < kReaches.size(); ++k) step_of_each(kWideReaches.size() + k, kReaches[k]);
    if (!smooth) return std::move(share_);
    std::vector<Level> levels{{static_cast<Index>(picture_.rows), static_cast<Index>(picture_.columns)}};
    while (levels.size() < kIterations.size() && std::min(levels.back().rows, levels.back().columns) >= kMinSide)
      levels.emplace_back((levels.back().rows + 1) / 2, (levels.back().columns + 1) / 2);
    for (int k = 0; k < kSteps; ++k) {
      gather(kRowTextures.back(), false);
      reduce_variation(evidence_, levels, {share_.data(), static_cast<Index>(pixels_)});
      for (double& value : share_) value = std::clamp(value, 0.0, max_share_);
    }
    return std::move(share_);
  }

  // One share for all pixels.
  double estimate_even() {
    start();
    for (const double texture : kRowTextures) step_of_all(texture);
    return share_.front();
  }

 private:
  // Row by row, while the compared rows are in the cache.
  void gather(double texture, bool with_guide = true) {
    const std::size_t columns = picture_.columns;
    const auto clear = [&](std::vector<double>& values, std::size_t first) {
      std::fill_n(values.begin() + static_cast<std::ptrdiff_t>(first), columns, 0);
    };
    for (std::size_t frame = 0; frame < picture_.frames; ++frame) {
      for (std::size_t row = 0; row < picture_.rows; ++row) {
        check_interrupt();
        const std::size_t first = row * columns;
        if (frame == 0)
          for (auto* values : {&evidence_.pull, &evidence_.weight}) clear(*values, first);
        if (frame == 0 && with_guide)
          for (auto* values : {&guide_.light, &guide_.variance}) clear(*values, first);
        clean_row(picture_, frame, row, change_[frame * picture_.rows + row], share_, now_);
        if (row >= lag_) compare_rows(now_, columns, row - lag_, row, texture, evidence_);
        if (with_guide) add_to_guide(now_, first, first + columns, guide_);
      }
      if (frame > 0) compare_frames(before_, now_, texture, evidence_);
      if (picture_.frames > 1) std::swap(now_, before_);
    }
  }

  void step_of_all(double texture) {
    gather(texture, false);
    const double pull = std::accumulate(evidence_.pull.begin(), evidence_.pull.end(), 0.0);
    const double weight = std::accumulate(evidence_.weight.begin(), evidence_.weight.end(), 0.0);
    if (weight > 0) std::fill(share_.begin(), share_.end(), std::clamp(share_[0] + pull / weight, 0.0, max_share_));
  }

  void step_of_each(std::size_t step, double reach) {
    gather(row_texture(step));
    find_passages(reach);
    for (std::size_t i = 0; i < pixels_; ++i) evidence_.pull[i] += evidence_.weight[i] * share_[i];
    smooth(evidence_.pull);
    smooth(evidence_.weight);
    for (std::size_t i = 0; i < pixels_; ++i)
      share_[i] = std::clamp((evidence_.pull[i] + kHold * share_[i]) / (evidence_.weight[i] + kHold), 0.0, max_share_);
  }

  void smooth(std::vector<double>& values) const {
    sum_along_columns(down_, picture_.columns, values);
    for (int time = 0; time < 2; ++time) sum_along_rows(across_, picture_.columns, values);
    sum_along_columns(down_, picture_.columns, values);
  }

  void start() {
    share_.assign(pixels_, std::min(0.5 * max_share_, 1.0));
    for (int k = 0; k < 4; ++k) step_of_all(kRowTextures.front());
  }

  void wide_steps() {
    start();
    for (std::size_t k = 0; k < kWideReaches.size(); ++k) step_of_each(k, kWideReaches[k]);
  }

  // wide_steps() on sums of columns.
  void take_wide_steps(std::span<const double> row_light) {
    const Blocks blocks = block_means(picture_, 1, kMergedAtFirst);
    const std::size_t columns = blocks.columns;
    ShareEstimator wider({blocks.light, blocks.variance, picture_.frames, picture_.rows, columns}, row_light,
                         kMergedAtFirst);
    wider.wide_steps();
    share_.resize(pixels_);
    for (std::size_t i = 0; i < pixels_; ++i)
      share_[i] = wider.share_[i / picture_.columns * columns + i % picture_.columns / kMergedAtFirst];
  }

  void find_passages(double reach) {
    now_.light = guide_.light;
    now_.variance = guide_.variance;
    finish_guide(now_);
    const double of_rows = std::max(reach, kLagsOfReach * static_cast<double>(lag_));
    if (picture_.frames == 1) reach = of_rows;  // between frames the lag does not matter
    passages(now_, picture_.columns, kLagsOfReach * static_cast<double>(lag_), edge_, down_);
    // Edges along rows are those of sums down the columns: less noise.
    for (auto* sums : {&guide_.light, &guide_.variance}) sum_along_columns(down_, picture_.columns, *sums);
    finish_guide(guide_);
    passages(guide_, 1, reach / merged_, edge_, across_);
    passages(now_, picture_.columns, of_rows, edge_, down_);
  }

  const BandedPicture picture_;
  double merged_;
  std::vector<double> change_;  // P
  std::size_t lag_;
  double edge_;
  std::size_t pixels_;
  double max_share_ = 0;
  std::vector<double> share_;
  ShareEvidence evidence_;
  Cleaned now_, before_, guide_;
  std::vector<double> down_, across_;
};

}  // namespace

std::size_t comparison_lag(std::span<const double> row_light, std::size_t rows) {
  const auto mean_square_change = [&](std::size_t lag) {
    double sum = 0;
    std::size_t count = 0;
    for (std::size_t first = 0; first < row_light.size(); first += rows)
      for (std::size_t n = 0; n + lag < rows; ++n, ++count)
        sum +=
            (row_light[first + n + lag] - row_light[first + n]) * (row_light[first + n + lag] - row_light[first + n]);
    return count > 0 ? sum / static_cast<double>(count) : 0;
  };
  const double variance = variance_of(row_light);
  const std::size_t most = std::clamp<std::size_t>(rows / 4, 1, 64);
  std::size_t lag = 1;
  while (lag < most && mean_square_change(lag) < 0.7 * variance) ++lag;
  return lag;
}

std::vector<double> light_share(const BandedPicture& picture, std::span<const double> row_light, bool smooth) {
  check(picture, row_light);
  return ShareEstimator(picture, row_light).estimate(row_light, smooth);
}

std::vector<std::vector<double>> colour_shares(std::span<const BandedPicture> colours,
                                               std::span<const std::vector<double>> row_lights) {
  std::vector<std::vector<double>> shares;
  std::vector<double> even;
  double gain = 0;  // by shares of each pixel over one for all
  for (std::size_t k = 0; k < colours.size(); ++k) {
    const std::size_t lag = comparison_lag(row_lights[k], colours[k].rows);
    shares.push_back(light_share(colours[k], row_lights[k]));
    even.push_back(ShareEstimator(colours[k], row_lights[k]).estimate_even());
    gain += row_misfit(colours[k], row_lights[k], {&even.back(), 1}, lag) -
            row_misfit(colours[k], row_lights[k], shares.back(), lag);
  }
  if (gain < kGainByChance * static_cast<double>(colours.size()))
    for (std::size_t k = 0; k < colours.size(); ++k) std::fill(shares[k].begin(), shares[k].end(), even[k]);
  return shares;
}

}  // namespace ocisac
