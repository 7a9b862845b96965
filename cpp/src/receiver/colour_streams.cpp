#include "receiver/colour_streams.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "chips/channel_growth.hpp"
#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
#include "core/linear_algebra.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kAgreement = 0.95;    // of decisions, or of opposite ones: one stream
constexpr double kMinOpposite = 0.25;  // of the largest swing: less may be the camera's colour correction

// Decisions of −1 and 1 of each stream, (chips × streams).
using Streams = MatrixXd;

MatrixXd matrix_of(const std::vector<std::vector<double>>& values) {  // (chips × colours)
  MatrixXd result(static_cast<Index>(values.front().size()), static_cast<Index>(values.size()));
  for (Index c = 0; c < result.cols(); ++c)
    result.col(c) = Eigen::Map<const VectorXd>(values[static_cast<std::size_t>(c)].data(), result.rows());
  return result;
}

VectorXd course(Index chips) { return VectorXd::LinSpaced(chips, -1, 1); }

// Without a straight course along the rows.
MatrixXd levelled(const MatrixXd& values) {
  const VectorXd place = course(values.rows());
  MatrixXd result = values.rowwise() - values.colwise().mean();
  result -= place * (place.transpose() * result) / place.squaredNorm();
  return result;
}

// Half way between the levels: a tenth of the chips lies above and below what is taken for them.
double threshold_of(const VectorXd& values) {
  std::vector<double> sorted(values.begin(), values.end());
  std::ranges::sort(sorted);
  return 0.5 * (sorted[sorted.size() / 10] + sorted[sorted.size() - 1 - sorted.size() / 10]);
}

VectorXd decisions(const VectorXd& values) {
  const double threshold = threshold_of(values);
  return values.unaryExpr([&](double value) { return value > threshold ? 1.0 : -1.0; });
}

bool is_one_stream(const VectorXd& a, const VectorXd& b) {
  return std::abs(a.dot(b)) >= (2 * kAgreement - 1) * static_cast<double>(a.size());
}

Streams without_duplicates(const Streams& streams) {
  Streams kept(streams.rows(), 0);
  for (Index k = 0; k < streams.cols(); ++k) {
    bool is_new = streams.col(k).cwiseAbs().sum() > std::abs(streams.col(k).sum());  // not constant
    for (Index other = 0; other < kept.cols(); ++other) is_new &= !is_one_stream(streams.col(k), kept.col(other));
    if (!is_new) continue;
    kept.conservativeResize(Eigen::NoChange, kept.cols() + 1);
    kept.col(kept.cols() - 1) = streams.col(k);
  }
  return kept;
}

// Mixing (streams + 2 × colours), the last rows a constant and a straight course, and each colour's noise variance.
struct Mixing {
  MatrixXd gains;
  VectorXd variance;
};

MatrixXd with_course(const Streams& streams) {
  MatrixXd terms(streams.rows(), streams.cols() + 2);
  terms << streams, VectorXd::Ones(streams.rows()), course(streams.rows());
  return terms;
}

Mixing fit_mixing(const MatrixXd& values, const Streams& streams) {
  const MatrixXd terms = with_course(streams);
  MatrixXd normal = gram(terms.transpose());
  normal.diagonal().array() += kEqual * static_cast<double>(terms.rows());
  Mixing mixing{product(inverse(normal), transposed_product(terms, values)), {}};
  const MatrixXd rest = values - product(terms, mixing.gains);
  mixing.variance = rest.colwise().squaredNorm().transpose() / static_cast<double>(values.rows());
  for (Index c = 0; c < values.cols(); ++c)
    mixing.variance(c) = std::max(mixing.variance(c),
                                  kEqual * (values.col(c).squaredNorm() / static_cast<double>(values.rows()) + 1e-300));
  return mixing;
}

// The nearest combination of bits for each chip.
Streams nearest(const MatrixXd& values, const Mixing& mixing) {
  const Index count = mixing.gains.rows() - 2, combinations = Index{1} << count;
  Streams streams(values.rows(), count);
  MatrixXd bits(combinations, count);
  for (Index k = 0; k < combinations; ++k)
    for (Index j = 0; j < count; ++j) bits(k, j) = ((k >> j) & 1) != 0 ? 1 : -1;
  const MatrixXd levels = product(bits, mixing.gains.topRows(count));
  const VectorXd place = course(values.rows());
  for (Index n = 0; n < values.rows(); ++n) {
    const Eigen::RowVectorXd swing = values.row(n) - mixing.gains.row(count) - place(n) * mixing.gains.row(count + 1);
    Index best = 0;
    double least = INFINITY;
    for (Index k = 0; k < combinations; ++k) {
      const double distance = ((swing - levels.row(k)).array().square() / mixing.variance.transpose().array()).sum();
      if (distance < least) {
        least = distance;
        best = k;
      }
    }
    streams.row(n) = bits.row(best);
  }
  return streams;
}

// Fits mixing and bits in turns, from the decisions of each column of `signals` (chips × streams at most).
Streams separated(const MatrixXd& values, const MatrixXd& signals) {
  Streams streams(signals.rows(), signals.cols());
  for (Index k = 0; k < signals.cols(); ++k) streams.col(k) = decisions(signals.col(k));
  streams = without_duplicates(streams);
  for (int round = 0; round < kManyIterations && streams.cols() > 0; ++round) {
    check_interrupt();
    const Streams next = without_duplicates(nearest(values, fit_mixing(values, streams)));
    if (next.cols() == streams.cols() && next == streams) break;
    streams = next;
  }
  return streams;
}

// Weights of the colours that follow a stream and null all others: A·R⁻¹ weighted least squares.
VectorXd unmixing(const Mixing& mixing, Index stream, const std::vector<Index>& colours) {
  const Index count = mixing.gains.rows() - 2;
  MatrixXd scaled(count, static_cast<Index>(colours.size()));
  for (Index c = 0; c < scaled.cols(); ++c)
    scaled.col(c) = mixing.gains.col(colours[static_cast<std::size_t>(c)]).head(count) /
                    std::sqrt(mixing.variance(colours[static_cast<std::size_t>(c)]));
  MatrixXd normal = gram(scaled);
  normal.diagonal().array() += kEqual * normal.trace();
  const VectorXd of_colours = product(inverse(normal), scaled).row(stream).transpose();
  VectorXd weights = VectorXd::Zero(mixing.gains.cols());
  for (Index c = 0; c < scaled.cols(); ++c) {
    const Index colour = colours[static_cast<std::size_t>(c)];
    weights(colour) = of_colours(c) / std::sqrt(mixing.variance(colour));
  }
  return weights;
}

// A stream or its opposite, in the colours that show it most.
void add_stream(const Mixing& mixing, Index stream, const std::vector<Index>& colours, std::vector<ColourStream>& out) {
  const bool alone = mixing.gains.rows() == 3;
  std::vector<Index> used = colours;
  if (!alone) {
    used.clear();
    for (Index c = 0; c < mixing.gains.cols(); ++c) used.push_back(c);
  }
  const Index shown = *std::ranges::max_element(
      colours, {}, [&](Index c) { return std::abs(mixing.gains(stream, c)) / std::sqrt(mixing.variance(c)); });
  const VectorXd weights = mixing.gains(stream, shown) * unmixing(mixing, stream, used);
  out.push_back({{weights.begin(), weights.end()}, static_cast<std::size_t>(shown)});
}

}  // namespace

std::vector<ColourStream> colour_streams(const std::vector<std::vector<double>>& values) {
  if (values.size() < 2 || values.front().size() < 8) return {};
  const MatrixXd levels = levelled(matrix_of(values));
  const VectorXd swings = (levels.colwise().squaredNorm() / static_cast<double>(levels.rows())).cwiseSqrt().transpose();
  std::vector<Index> by_swing;
  for (Index c = 0; c < swings.size(); ++c)
    if (swings(c) > kNextToNone * swings.maxCoeff()) by_swing.push_back(c);
  std::ranges::sort(by_swing, [&](Index a, Index b) { return swings(a) > swings(b); });
  if (by_swing.empty()) return {};
  by_swing.resize(std::min<std::size_t>(by_swing.size(), 3));
  MatrixXd shown(levels.rows(), static_cast<Index>(by_swing.size()));
  for (std::size_t k = 0; k < by_swing.size(); ++k) shown.col(static_cast<Index>(k)) = levels.col(by_swing[k]);
  const Streams streams = separated(levels, shown);
  if (streams.cols() == 0) return {};
  const Mixing mixing = fit_mixing(levels, streams);
  std::vector<ColourStream> found;
  for (Index stream = 0; stream < streams.cols(); ++stream) {
    const auto gains = mixing.gains.row(stream);
    const double largest = gains.cwiseAbs().maxCoeff();
    Index strongest = 0;
    gains.cwiseAbs().maxCoeff(&strongest);
    std::vector<Index> same, opposite;
    for (Index c = 0; c < gains.size(); ++c) {
      Index main = 0;
      mixing.gains.col(c).head(streams.cols()).cwiseAbs().maxCoeff(&main);
      if (main != stream && c != strongest) continue;
      if (gains(c) * gains(strongest) > 0)
        same.push_back(c);
      else if (std::abs(gains(c)) > kMinOpposite * largest)
        opposite.push_back(c);
    }
    for (const auto* colours : {&same, &opposite})
      if (!colours->empty()) add_stream(mixing, stream, *colours, found);
  }
  return found;
}

CombinedColumn sum_of(const std::vector<CombinedColumn>& columns, const ColourStream& stream) {
  CombinedColumn sum = columns[stream.colour];
  std::ranges::fill(sum.signal, 0.0);
  double variance = 0;
  for (std::size_t c = 0; c < columns.size(); ++c) {
    for (std::size_t n = 0; n < sum.signal.size(); ++n) sum.signal[n] += stream.weights[c] * columns[c].signal[n];
    if (stream.weights[c] == 0) continue;
    variance += std::pow(stream.weights[c] * columns[c].noise, 2);
    sum.saturated |= columns[c].saturated;
  }
  sum.noise = std::sqrt(variance);
  return sum;
}

}  // namespace ocisac
