#include "ocisac/chips/row_warp.hpp"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "columns/moving_mean.hpp"
#include "ocisac/chips/refine_channel.hpp"
#include "rows/exposed_chips.hpp"

namespace ocisac {

namespace {

constexpr double kNearbyChips = 4;  // either side, for the noise of a row
constexpr double kMaxCorrelation = 0.95;

// Displacement and its rate: mean and covariance.
struct Motion {
  Eigen::Vector2d mean;
  Eigen::Matrix2d covariance;
};

// From one row to the next.
Eigen::Matrix2d step() { return Eigen::Matrix2d{{1, 1}, {0, 1}}; }

Motion predicted(const Motion& last) {
  Motion next{step() * last.mean, step() * last.covariance * step().transpose()};
  next.covariance(1, 1) += kWarpStep * kWarpStep;
  return next;
}

Motion updated(const Motion& before, double observed, double slope, double noise) {
  const Eigen::Vector2d seen = slope * before.covariance.col(0);
  const Eigen::Vector2d gain = seen / (slope * seen[0] + noise * noise);
  return {before.mean + gain * (observed - slope * before.mean[0]), before.covariance - gain * seen.transpose()};
}

// Cubic interpolation (Catmull–Rom), held at the ends.
double between_rows(std::span<const double> rows, double place) {
  const auto last = static_cast<double>(rows.size()) - 1;
  const auto value = [&](double row) { return rows[static_cast<std::size_t>(std::clamp(row, 0.0, last))]; };
  place = std::clamp(place, 0.0, last);
  const double row = std::floor(place), t = place - row;
  const double a = value(row - 1), b = value(row), c = value(row + 1), d = value(row + 2);
  return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)));
}

}  // namespace

std::vector<double> unwarped(std::span<const double> signal, const RowWarp& warp) {
  std::vector<double> even(signal.begin(), signal.end());
  for (std::size_t m = 0; m < warp.size(); ++m) even[m] = between_rows(signal, static_cast<double>(m) - warp[m]);
  return even;
}

std::vector<double> warped(std::span<const double> even_rows, const RowWarp& warp) {
  std::vector<double> picture(even_rows.begin(), even_rows.end());
  for (std::size_t n = 0; n < warp.size(); ++n) {
    const auto row = static_cast<double>(n);
    picture[n] = between_rows(even_rows, row + between_rows(warp, row + warp[n]));
  }
  return picture;
}

double picture_row(double even_row, const RowWarp& warp) {
  return warp.empty() ? even_row : even_row - between_rows(warp, even_row);
}

void set_rate(double rows_per_chip, RowWarp& warp, ChipClock& clock) {
  const double scale = rows_per_chip / clock.rows_per_chip;
  const double middle = 0.5 * (static_cast<double>(warp.size()) - 1);
  RowWarp scaled(warp.size());
  for (std::size_t m = 0; m < scaled.size(); ++m) {
    const auto row = static_cast<double>(m);
    const double before = middle + (row - middle) / scale;
    scaled[m] = row - before + between_rows(warp, before);
  }
  warp = std::move(scaled);
  clock.phase = middle + scale * (clock.phase - middle);
  clock.rows_per_chip = rows_per_chip;
}

RowWarp smooth_displacement(std::span<const double> observed, std::span<const double> slopes,
                            std::span<const double> noise) {
  const std::size_t rows = observed.size();
  std::vector<Motion> filtered(rows);
  Motion ahead{Eigen::Vector2d::Zero(), Eigen::Vector2d(kWarpStd, kWarpRateStd).cwiseAbs2().asDiagonal()};
  for (std::size_t n = 0; n < rows; ++n) {
    filtered[n] = updated(ahead, observed[n], slopes[n], noise[n]);
    ahead = predicted(filtered[n]);
  }
  RowWarp smooth(rows);
  Eigen::Vector2d mean = ahead.mean;  // of the row after, given all rows
  for (std::size_t n = rows; n-- > 0;) {
    const Motion& now = filtered[n];
    const Motion next = predicted(now);
    mean = now.mean + now.covariance * step().transpose() * (next.covariance.inverse() * (mean - next.mean));
    smooth[n] = mean[0];
  }
  return smooth;
}

RowWarp fit_warp(std::span<const double> even_rows, const RowWarp& warp, const KnownChips& chips,
                 const ChannelEstimate& channel, bool doubtful) {
  const std::size_t rows = even_rows.size();
  const ChipClock clock = with_min_exposure(channel.clock);
  const ChipBox box(chips, clock);
  const auto left = channel_residual(even_rows, chips, channel);
  auto observed = left;
  std::vector<double> slopes(rows), squares(rows), products(rows);
  for (std::size_t n = 0; n < rows; ++n) {
    const auto row = static_cast<double>(n);
    slopes[n] = -channel.swing_at(row, rows) * box.at(row, clock, 0).by_phase;
    squares[n] = left[n] * left[n];
    products[n] = n > 0 ? left[n] * left[n - 1] : 0.0;
    if (!warp.empty()) observed[n] += slopes[n] * warp[n];
  }
  // Rows whose residual is correlated count as fewer.
  const auto reach = static_cast<std::size_t>(kNearbyChips * clock.rows_per_chip + 0.5 * clock.exposure_rows);
  const auto near_squares = moving_mean(squares, reach), near_products = moving_mean(products, reach);
  std::vector<double> noise(rows);
  for (std::size_t n = 0; n < rows; ++n) {
    const double least = std::max(kMinDetectorNoise * channel.swing_at(static_cast<double>(n), rows), 1e-300);
    const double correlation =
        !doubtful ? 0.0 : std::clamp(near_products[n] / std::max(near_squares[n], least * least), 0.0, kMaxCorrelation);
    if (n < channel.rows.begin || n >= channel.rows.end) {
      noise[n] = std::numeric_limits<double>::infinity();
      continue;
    }
    noise[n] = std::max(std::sqrt(near_squares[n] * (1 + correlation) / (1 - correlation)), least);
  }
  return smooth_displacement(observed, slopes, noise);
}

}  // namespace ocisac
