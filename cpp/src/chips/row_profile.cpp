#include "ocisac/chips/row_profile.hpp"

#include <algorithm>
#include <cmath>

#include "columns/moving_mean.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kMinKnownFrames = 3;

// Sums of a row over the frames, as deviations from their means.
struct RowSums {
  double mean_exposed = 0, mean_signal = 0, squares = 0, products = 0;
};

RowSums sums_of(std::span<const ProfileFrame> frames, std::size_t row, std::size_t known) {
  RowSums sums;
  for (const ProfileFrame& frame : frames) {
    if (frame.exposed.empty()) continue;
    sums.mean_exposed += frame.exposed[row] / static_cast<double>(known);
    sums.mean_signal += frame.signal[row] / static_cast<double>(known);
  }
  for (const ProfileFrame& frame : frames) {
    if (frame.exposed.empty()) continue;
    const double off = frame.exposed[row] - sums.mean_exposed;
    sums.squares += off * off;
    sums.products += off * (frame.signal[row] - sums.mean_signal);
  }
  return sums;
}

}  // namespace

std::optional<RowProfile> first_profile(std::span<const ProfileFrame> frames, std::size_t smooth) {
  if (frames.size() < 2) return std::nullopt;
  const std::size_t rows = frames.front().signal.size();
  const auto count = static_cast<double>(frames.size());
  RowProfile profile{std::vector<double>(rows), std::vector<double>(rows)};
  for (std::size_t n = 0; n < rows; ++n) {
    for (const ProfileFrame& frame : frames) profile.dark[n] += frame.signal[n] / count;
    for (const ProfileFrame& frame : frames) profile.swing[n] += std::pow(frame.signal[n] - profile.dark[n], 2) / count;
  }
  if (rows == 0 || !(*std::ranges::min_element(profile.dark) > 0)) return std::nullopt;
  for (std::size_t n = 0; n < rows; ++n) profile.swing[n] /= profile.dark[n] * profile.dark[n];
  profile.swing = moving_mean(profile.swing, smooth);
  for (std::size_t n = 0; n < rows; ++n) profile.swing[n] = profile.dark[n] * std::sqrt(profile.swing[n]);
  if (!(*std::ranges::max_element(profile.swing) > 0)) return std::nullopt;
  return profile;
}

std::optional<RowProfile> fit_profile(std::span<const ProfileFrame> frames, std::span<const double> shape,
                                      std::size_t smooth, double weight) {
  const auto known = static_cast<std::size_t>(
      std::ranges::count_if(frames, [](const ProfileFrame& frame) { return !frame.exposed.empty(); }));
  if (known < kMinKnownFrames) return std::nullopt;
  const std::size_t rows = shape.size();
  std::vector<RowSums> sums(rows);
  std::vector<double> squares(rows), products(rows);
  double mean_squares = 0;
  for (std::size_t n = 0; n < rows; ++n) {
    sums[n] = sums_of(frames, n, known);
    squares[n] = sums[n].squares * shape[n] * shape[n];
    products[n] = sums[n].products * shape[n];
    mean_squares += sums[n].squares / static_cast<double>(rows);
  }
  if (!(mean_squares > 0)) return std::nullopt;
  const auto near_squares = moving_mean(squares, smooth), near_products = moving_mean(products, smooth);
  const double prior = weight * mean_squares;
  RowProfile profile{std::vector<double>(rows), std::vector<double>(rows)};
  for (std::size_t n = 0; n < rows; ++n) {
    if (!(near_squares[n] > 0) || !(near_products[n] > 0) || shape[n] == 0) continue;
    const double near = shape[n] * near_products[n] / near_squares[n];
    profile.swing[n] = (sums[n].products + prior * near) / (sums[n].squares + prior);
    profile.dark[n] = sums[n].mean_signal - profile.swing[n] * sums[n].mean_exposed;
  }
  return profile;
}

RowRange profile_rows(const RowProfile& profile, double share) {
  const double lowest = share * *std::ranges::max_element(profile.swing);
  RowRange longest{0, 0};
  for (std::size_t begin = 0; begin < profile.swing.size(); ++begin) {
    std::size_t end = begin;
    while (end < profile.swing.size() && profile.swing[end] > lowest) ++end;
    if (end - begin > longest.size()) longest = {begin, end};
    begin = end;
  }
  return longest;
}

std::vector<double> without_profile(std::span<const double> signal, const RowProfile& profile, RowRange rows) {
  std::vector<double> rest(rows.size());
  for (std::size_t n = 0; n < rest.size(); ++n)
    rest[n] = (signal[rows.begin + n] - profile.dark[rows.begin + n]) / profile.swing[rows.begin + n];
  return rest;
}

}  // namespace ocisac
