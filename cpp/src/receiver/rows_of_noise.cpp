#include "receiver/rows_of_noise.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/chips/row_nuisance.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

constexpr double kSlowTerms = 4;  // cosines along the frame

// Median of the squares between a frame and all but the one before it.
double usual_squares(std::span<const std::span<const double>> frames, std::size_t frame) {
  std::vector<double> squares;
  for (std::size_t k = 0; k < frames.size(); ++k)
    if (k != frame && k + 1 != frame) squares.push_back(squares_about_mean(difference(frames[frame], frames[k])));
  return median(std::move(squares));
}

}  // namespace

bool is_noise(std::span<const double> signal) {
  const auto fit = remove_nuisance(signal, {0.5 * kSlowTerms / static_cast<double>(signal.size()), {}});
  if (!fit) return false;
  const double mean = mean_of(fit->rest);
  const auto rest = without_mean(fit->rest);
  const auto varies = [&](double value) { return std::abs(value) > kEqual * std::abs(mean); };
  return std::ranges::none_of(rest, varies) || is_white(rest);
}

bool is_mean(std::span<const double> before, std::span<const double> frame, std::span<const double> after) {
  const auto apart = difference(after, before);
  auto rest = difference(frame, before);
  for (std::size_t n = 0; n < rest.size(); ++n) rest[n] -= 0.5 * apart[n];
  return squares_about_mean(rest) < kSmallShare * squares_about_mean(apart) && !is_noise(apart);
}

std::vector<std::uint8_t> repeated_frames(std::span<const std::span<const double>> frames) {
  std::vector<std::uint8_t> repeated(frames.size());
  for (std::size_t k = 1; k < frames.size() && frames.size() > 2; ++k) {
    const auto rows = difference(frames[k], frames[k - 1]);
    repeated[k] = squares_about_mean(rows) < kMostly * usual_squares(frames, k) && is_noise(rows);
  }
  return repeated;
}

}  // namespace ocisac
