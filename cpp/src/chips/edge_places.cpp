#include "chips/edge_places.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>

#include "chips/channel_equations.hpp"
#include "core/legendre.hpp"

namespace ocisac {

namespace {

constexpr int kPlaceRounds = 4;

}  // namespace

EdgeNoise::EdgeNoise(std::size_t chips, std::size_t seen, double edge_std)
    : chips_(chips), seen_(seen), normal_(chips, seen), cross_(chips * (2 * seen + 1), 0.0), right_(chips, 0.0) {
  for (std::size_t edge = 0; edge < chips; ++edge) normal_.at(edge, 0) = 1 / (edge_std * edge_std);
}

void EdgeNoise::add_row(std::size_t newest, std::span<const double> shares, double per_length, double weight,
                        double value) {
  while (shares.back() <= 0 && shares.size() > 1) shares = shares.first(shares.size() - 1);  // it is not seen
  for (std::size_t i = 0; i + 1 < shares.size(); ++i) {
    const std::size_t edge = newest - i;
    right_[edge] += value * per_length;
    for (std::size_t back = 0; i + back + 1 < shares.size(); ++back)
      normal_.at(edge, back) += weight * per_length * per_length;
    double* of_edge = &cross_[edge * (2 * seen_ + 1) + seen_ + i];
    for (std::size_t j = 0; j < shares.size(); ++j)
      *(of_edge - static_cast<std::ptrdiff_t>(j)) += weight * per_length * shares[j];
  }
}

void EdgeNoise::take_off(std::size_t band, std::span<double> normal, std::span<double> target) {
  normal_.factor();
  normal_.forward(right_);
  const std::size_t width = seen_ + 1 + 2 * band;  // of a column of X: it has decayed after two bands
  std::vector<double> columns(chips_ * width, 0.0);
  const auto first_edge = [&](std::size_t chip) { return chip - std::min(chip, seen_); };
  const auto column = [&](std::size_t chip) {
    const std::size_t first = first_edge(chip);
    return std::span(columns).subspan(chip * width, std::min(width, chips_ - first));
  };
  for (std::size_t chip = 0; chip < chips_; ++chip) {
    const std::size_t first = first_edge(chip), last = std::min(chip + seen_, chips_ - 1);
    const auto x = column(chip);
    for (std::size_t edge = first; edge <= last; ++edge)
      x[edge - first] = cross_[edge * (2 * seen_ + 1) + seen_ + chip - edge];
    normal_.forward(x, first);
    for (std::size_t k = 0; k < x.size(); ++k) target[chip] -= x[k] * right_[first + k];
    for (std::size_t back = 0; back <= std::min(band, chip); ++back) {
      const auto earlier = column(chip - back);
      const std::size_t skipped = first - first_edge(chip - back);
      for (std::size_t k = 0; k < x.size() && k + skipped < earlier.size(); ++k)
        normal[chip * (band + 1) + back] -= x[k] * earlier[k + skipped];
    }
  }
}

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Edges between known chips that differ, and the rows that see them.
class Edges {
 public:
  Edges(const KnownChips& chips, const ChipClock& clock)
      : exposure_(clock.exposure_rows),
        reach_(0.5 * clock.rows_per_chip),
        band_(static_cast<std::size_t>(std::ceil(clock.exposure_rows / clock.rows_per_chip)) + 2),
        prior_(1 / std::pow(clock.edge_std * clock.rows_per_chip, 2)) {
    for (std::size_t k = 1; k < chips.levels.size(); ++k)
      if (const double step = chips.levels[k] - chips.levels[k - 1]; step != 0) {
        const auto chip = static_cast<double>(chips.first + static_cast<std::ptrdiff_t>(k));
        on_clock_.push_back(clock.phase + chip * clock.rows_per_chip);
        steps_.push_back(step);
      }
    places_ = on_clock_;
  }
  [[nodiscard]] std::size_t count() const { return places_.size(); }

  // Each chip's edge lies off the clock by so many standard deviations of the prior; 0 without an edge.
  [[nodiscard]] std::vector<double> off(const KnownChips& chips) const {
    std::vector<double> off(chips.levels.size(), 0.0);
    for (std::size_t k = 1, edge = 0; k < off.size(); ++k)
      if (chips.levels[k] != chips.levels[k - 1]) {
        off[k] = (places_[edge] - on_clock_[edge]) * std::sqrt(prior_);
        ++edge;
      }
    return off;
  }

  // Light that their displacement adds to each row.
  [[nodiscard]] VectorXd added(std::size_t rows) const {
    VectorXd light = VectorXd::Zero(static_cast<Index>(rows));
    for_rows({0, rows}, [&](Index n, double begin, std::size_t first, std::size_t end) {
      for (std::size_t k = first; k < end; ++k)
        light(n) +=
            steps_[k] / exposure_ *
            (std::clamp(on_clock_[k], begin, begin + exposure_) - std::clamp(places_[k], begin, begin + exposure_));
    });
    return light;
  }

  // One step of least squares with other unknowns, whose columns are `others`, beside their places; returns theirs.
  VectorXd move(RowRange rows, const VectorXd& left, const VectorXd& swing, const MatrixXd& others, double variance) {
    BandedFactors normal(count(), band_);
    MatrixXd right = MatrixXd::Zero(static_cast<Index>(count()), others.cols() + 1);
    for (std::size_t k = 0; k < count(); ++k) {
      normal.at(k, 0) = variance * prior_;
      right(static_cast<Index>(k), 0) = variance * prior_ * (on_clock_[k] - places_[k]);
    }
    for_rows(rows, [&](Index n, double begin, std::size_t first, std::size_t end) {
      const auto slope = [&](std::size_t k) {
        return places_[k] > begin && places_[k] < begin + exposure_ ? -steps_[k] * swing(n) / exposure_ : 0.0;
      };
      for (std::size_t k = first; k < end; ++k) {
        const double by_edge = slope(k);
        if (by_edge == 0) continue;
        for (std::size_t back = 0; back <= std::min(band_, k - first); ++back)
          normal.at(k, back) += by_edge * slope(k - back);
        right(static_cast<Index>(k), 0) += by_edge * left(n);
        right.row(static_cast<Index>(k)).tail(others.cols()) += by_edge * others.row(n);
      }
    });
    normal.factor();
    for (Index k = 0; k < right.cols(); ++k) normal.forward({right.col(k).data(), count()});
    const auto shared = right.rightCols(others.cols());
    const auto seen = [&rows](const auto& columns) {
      return columns.middleRows(static_cast<Index>(rows.begin), static_cast<Index>(rows.size()));
    };
    const MatrixXd of_others = seen(others).transpose() * seen(others) - shared.transpose() * shared;
    VectorXd steps = of_others.ldlt().solve(seen(others).transpose() * seen(left) - shared.transpose() * right.col(0));
    VectorXd moves = right.col(0) - shared * steps;
    normal.backward({moves.data(), count()});
    for (std::size_t k = 0; k < count(); ++k)
      places_[k] = std::clamp(places_[k] + moves(static_cast<Index>(k)), on_clock_[k] - reach_, on_clock_[k] + reach_);
    return steps;
  }

 private:
  // row(n, begin of its exposure, first edge that it may see, one past the last).
  template <typename Row>
  void for_rows(RowRange rows, const Row& row) const {
    std::size_t first = 0, end = 0;
    for (std::size_t n = rows.begin; n < rows.end; ++n) {
      const double begin = static_cast<double>(n) - 0.5 * exposure_;
      while (first < count() && on_clock_[first] + reach_ < begin) ++first;
      while (end < count() && on_clock_[end] - reach_ < begin + exposure_) ++end;
      row(static_cast<Index>(n), begin, first, end);
    }
  }

  double exposure_, reach_;  // rows; of an edge from the clock: further off, it is that of another chip
  std::size_t band_;
  double prior_;                                   // inverse variance of a place, 1/rows²
  std::vector<double> on_clock_, places_, steps_;  // rows, rows, ±1
};

}  // namespace

PlacedEdges place_edges(std::span<const double> signal, const KnownChips& chips, ChannelEstimate& channel) {
  const std::size_t rows = signal.size(), dark = channel.dark.size(), levels = dark + channel.swing.size();
  Edges edges(chips, channel.clock);
  std::vector<double> on_clock(rows);
  expose_chips(chips, channel.clock, on_clock);
  VectorXd added = VectorXd::Zero(static_cast<Index>(rows)), left = added, swing = added;
  MatrixXd others(static_cast<Index>(rows), static_cast<Index>(levels));
  const double freedom = static_cast<double>(channel.rows.size()) - static_cast<double>(edges.count() + levels);
  for (int round = 0; round <= kPlaceRounds; ++round) {
    double squares = 0;
    for (std::size_t n = 0; n < rows; ++n) {
      const auto row = static_cast<Index>(n);
      const double x = along_frame(static_cast<double>(n), rows), light = on_clock[n] + added(row);
      std::array<double, kHighestDegree + 1> basis{};
      legendre(x, basis);
      for (std::size_t k = 0; k < levels; ++k)
        others(row, static_cast<Index>(k)) = k < dark ? basis[k] : basis[k - dark] * light;
      swing(row) = channel.swing_at(static_cast<double>(n), rows);
      left(row) = signal[n] - channel.dark_at(static_cast<double>(n), rows) - swing(row) * light;
      if (n >= channel.rows.begin && n < channel.rows.end) squares += left(row) * left(row);
    }
    if (round > 0) channel.noise = std::sqrt(squares / std::max(freedom, 1.0));
    if (round == kPlaceRounds) break;
    const VectorXd steps = edges.move(channel.rows, left, swing, others, channel.noise * channel.noise);
    for (std::size_t k = 0; k < levels; ++k)
      (k < dark ? channel.dark[k] : channel.swing[k - dark]) += steps(static_cast<Index>(k));
    added = edges.added(rows);
  }
  PlacedEdges placed{{signal.begin(), signal.end()}, edges.off(chips)};
  for (std::size_t n = 0; n < rows; ++n) placed.rest[n] -= swing(static_cast<Index>(n)) * added(static_cast<Index>(n));
  return placed;
}

}  // namespace ocisac
