#include "tones/tone_combination.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "core/levels.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::MatrixX2d;
using Eigen::MatrixXd;

// Amplitudes (signals × 2) of one frame, shrunk towards their mean; `noise`: noise energy of one of them.
MatrixX2d shrunken(const MatrixX2d& amplitudes, double noise) {
  const Eigen::RowVector2d mean = amplitudes.colwise().mean();
  const MatrixX2d differences = amplitudes.rowwise() - mean;
  const double spread = differences.squaredNorm();
  const double chance = 2 * static_cast<double>(amplitudes.rows() - 1) * noise;
  const double keep = spread > chance ? 1 - chance / spread : 0;
  return (keep * differences).rowwise() + mean;
}

// Amplitudes along their principal axes: orthogonal, the stronger first.
MatrixX2d principal(const MatrixX2d& amplitudes) {
  const Eigen::Matrix2d gram = amplitudes.transpose() * amplitudes;
  const double angle = 0.5 * std::atan2(gram(0, 1), (gram(0, 0) - gram(1, 1)) / 2);  // of the major axis
  Eigen::Matrix2d axes;
  axes << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  return amplitudes * axes;
}

}  // namespace

CombinedTone combine_by_tone(std::span<const double> signals, std::size_t rows, std::size_t group,
                             const PeriodicFit& fit) {
  const auto length = static_cast<Index>(rows), members = static_cast<Index>(group);
  const Eigen::Map<const MatrixXd> y(signals.data(), length, static_cast<Index>(signals.size() / rows));
  const Eigen::Map<const MatrixX2d> amplitudes(fit.amplitudes().data(), y.cols(), 2);
  const double spare = static_cast<double>(rows - fit.model.parameters()) * static_cast<double>(y.cols());
  const double noise = 2 / static_cast<double>(rows) * fit.total_residual() / spare;
  std::vector<MatrixX2d> weights;
  bool two = false;
  double resultant = 0, lengths = 0;
  for (Index first = 0; first < y.cols(); first += members) {
    const MatrixX2d estimated = shrunken(amplitudes.middleRows(first, members), noise);
    resultant += estimated.colwise().sum().norm();
    lengths += estimated.rowwise().norm().sum();
    weights.push_back(principal(estimated));
    const Eigen::RowVector2d energies = weights.back().colwise().squaredNorm();
    two = two || (group > 1 && energies(1) > std::max(chance_energy(group) * noise, kEqual * energies(0)));
    weights.back().colwise().normalize();
  }
  const Index kept = two ? 2 : 1, frames = static_cast<Index>(weights.size());
  CombinedTone out{std::vector<double>(static_cast<std::size_t>(frames * kept * length)),
                   lengths > 0 ? resultant / lengths : 1};
  Eigen::Map<MatrixXd> combined(out.signals.data(), length, frames * kept);
  for (Index frame = 0; frame < frames; ++frame)
    combined.middleCols(frame * kept, kept) =
        y.middleCols(frame * members, members) * weights[static_cast<std::size_t>(frame)].leftCols(kept);
  return out;
}

}  // namespace ocisac
