#include "ocisac/chips/preamble.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "chips/channel_growth.hpp"
#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/core/require.hpp"
#include "rows/exposed_chips.hpp"

namespace ocisac {

namespace {

constexpr double kPhaseSlack = 0.2;      // max error of the grid of rates at the ends of the preamble, chips
constexpr double kPlaceStep = 0.3;       // chips, step of the grid of positions; at most a row
constexpr std::size_t kCandidates = 12;  // positions for fits of the channel
constexpr double kToleranceError = 0.5;  // standard error of a rate uniformly within the tolerance

// Sliding sums of the rows: residual squares about a mean and a slope.
class WindowSums {
 public:
  explicit WindowSums(std::span<const double> signal) : sums_(signal.size() + 1) {
    for (std::size_t n = 0; n < signal.size(); ++n) {
      const auto row = static_cast<double>(n);
      sums_[n + 1] = {sums_[n][0] + signal[n], sums_[n][1] + row * signal[n], sums_[n][2] + signal[n] * signal[n]};
    }
  }
  [[nodiscard]] double squares_left(std::size_t begin, std::size_t count) const {
    const auto &low = sums_[begin], &high = sums_[begin + count];
    const auto n = static_cast<double>(count), middle = static_cast<double>(begin) + 0.5 * (n - 1);
    const double value = high[0] - low[0], slope = high[1] - low[1] - middle * value;
    return high[2] - low[2] - value * value / n - 12 * slope * slope / (n * (n * n - 1));
  }

 private:
  std::vector<std::array<double, 3>> sums_;  // of values, moments and squares
};

// Removes mean and slope and normalises to unit length; empty where nothing remains.
std::vector<double> as_direction(std::vector<double> shape) {
  remove_line(shape);
  const double square = scalar_product(shape, shape);
  if (square < kEqual * static_cast<double>(shape.size())) return {};
  for (double& value : shape) value /= std::sqrt(square);
  return shape;
}

struct Candidate {
  ChipClock clock;
  double gain = 0;  // gain in log-likelihood
};

double gain_of(double explained, double count) {
  return -0.5 * count * std::log(1 - std::clamp(explained, 0.0, 1 - kEqual));
}

// Best correlation for each position, in bins of a chip, with the preamble as it appears in the rows that depend on it
// alone; the first of these is `past` rows after their beginning. `relative`: its clock, to that row.
void correlate(std::span<const double> signal, const WindowSums& sums, std::span<const double> preamble,
               const ChipClock& relative, double past, std::vector<Candidate>& places) {
  const double whole = static_cast<double>(preamble.size()) * relative.rows_per_chip - relative.exposure_rows;
  std::vector<double> shape(static_cast<std::size_t>(std::floor(whole - past)) + 1);
  expose_chips({preamble, 0}, relative, shape);
  shape = as_direction(std::move(shape));
  const std::size_t length = shape.size();
  if (length < 3 || length > signal.size()) return;
  std::vector<double> products(signal.size() - length + 1, 0.0);
  for (std::size_t j = 0; j < length; ++j) {  // along the positions, so that the additions are independent
    const double weight = shape[j];
    const double* values = signal.data() + j;
    for (std::size_t n = 0; n < products.size(); ++n) products[n] += weight * values[n];
  }
  for (std::size_t n = 0; n < products.size(); ++n) {
    const double squares = sums.squares_left(n, length);
    if (products[n] <= 0 || !(squares > 0)) continue;
    const double gain = gain_of(products[n] * products[n] / squares, static_cast<double>(length));
    ChipClock clock = relative;
    clock.phase += static_cast<double>(n);
    const double chip = std::floor(std::max(clock.phase + 0.5 * clock.exposure_rows, 0.0) / clock.rows_per_chip);
    Candidate& place = places[std::min(static_cast<std::size_t>(chip), places.size() - 1)];
    if (gain > place.gain) place = {clock, gain};
  }
}

std::vector<double> exposures(const PreambleSearch& search, std::size_t chips) {
  if (search.exposure_rows) return {*search.exposure_rows};
  const double longest = std::min(search.max_exposure_chips, static_cast<double>(chips) - kMinChipsSeen);
  return exposures_up_to(longest + 0.25, search.rows_per_chip);
}

// `signal`: less its mean.
std::vector<Candidate> best_places(std::span<const double> signal, const WindowSums& sums,
                                   std::span<const double> preamble, const PreambleSearch& search) {
  const auto chips = static_cast<double>(preamble.size());
  std::vector<Candidate> places(
      static_cast<std::size_t>(static_cast<double>(signal.size()) / ((1 - search.tolerance) * search.rows_per_chip)) +
      1);
  for (double exposure_rows : exposures(search, preamble.size())) {
    const double seen = chips - exposure_rows / search.rows_per_chip;
    if (seen < std::min(kMinChipsSeen, 0.9 * chips)) continue;
    for (double rows_per_chip : rates_within(search.rows_per_chip, search.tolerance, seen, kPhaseSlack))
      for (double k = 0, steps = std::ceil(1 / (kPlaceStep * rows_per_chip)); k < steps; ++k)
        correlate(signal, sums, preamble, {rows_per_chip, -k / steps - 0.5 * exposure_rows, exposure_rows}, k / steps,
                  places);
  }
  std::erase_if(places, [](const Candidate& place) { return !(place.gain > 0); });
  std::ranges::stable_sort(places, std::ranges::greater{}, &Candidate::gain);
  places.resize(std::min(places.size(), std::max(kCandidates, 3 * search.max_matches)));
  return places;
}

std::optional<PreambleMatch> match_at(std::span<const double> signal, const WindowSums& sums,
                                      std::span<const double> preamble, const PreambleSearch& search,
                                      const ChipClock& clock) {
  // The grid's rate is the start; the nominal rate with its tolerance is the prior.
  const ChannelModel free{1, 0, search.exposure_rows.has_value()};
  ChannelModel bound = free;
  bound.rate_std = kToleranceError * search.tolerance * search.rows_per_chip;
  auto channel = fit_channel(signal, {preamble, 0}, clock, free);
  if (!channel || channel->errors.rows_per_chip_std() > 0.2 * bound.rate_std) {
    const double middle = 0.5 * static_cast<double>(preamble.size());
    ChipClock nominal = channel ? channel->clock : clock;
    nominal.phase += middle * (nominal.rows_per_chip - search.rows_per_chip);
    nominal.rows_per_chip = search.rows_per_chip;
    if (bound.rate_std > 0) channel = fit_channel(signal, {preamble, 0}, nominal, bound);
  }
  if (!channel || !(channel->swing[0] > 0) || !(channel->errors.covariance[4] >= 0)) return std::nullopt;
  if (channel->has_other_rate(search.rows_per_chip, search.tolerance)) return std::nullopt;
  const double squares = sums.squares_left(channel->rows.begin, channel->rows.size());
  const double left = channel->noise * channel->noise * static_cast<double>(channel->rows.size());
  if (!(squares > left)) return std::nullopt;
  const double explained = 1 - left / squares;
  const double rows_per_chip = std::max(channel->clock.rows_per_chip, 1.0);
  const double chips = static_cast<double>(channel->rows.size()) / rows_per_chip;
  const double tried = static_cast<double>(signal.size()) / rows_per_chip;
  return PreambleMatch{std::move(*channel), explained, gain_of(explained, chips) - std::log(tried)};
}

}  // namespace

std::vector<PreambleMatch> find_preamble(std::span<const double> signal, std::span<const double> preamble,
                                         const PreambleSearch& search) {
  check_rows_per_chip(search.rows_per_chip);
  require(search.tolerance >= 0 && search.tolerance < 0.5, "tolerance", search.tolerance, "0 to 0.5");
  if (search.exposure_rows) require_not_negative("exposure_rows", *search.exposure_rows);
  require_positive("max_exposure_chips", search.max_exposure_chips);
  require(preamble.size() >= 2, "preamble", preamble.size(), "at least two chips");
  for (double level : preamble) require_finite("preamble", level);
  for (double value : signal) require_finite("signal", value);
  if (signal.empty()) return {};
  const auto centred = without_mean(signal);
  const WindowSums sums(centred);
  std::vector<PreambleMatch> matches;
  for (const auto& place : best_places(centred, sums, preamble, search)) {
    auto match = match_at(signal, sums, preamble, search, place.clock);
    if (match && match->certainty > kMinCertainty) matches.push_back(std::move(*match));
  }
  std::ranges::stable_sort(matches, std::ranges::greater{}, &PreambleMatch::certainty);
  std::vector<PreambleMatch> apart;
  for (auto& match : matches) {
    const auto overlaps = [&](const PreambleMatch& other) {
      return std::abs(other.channel.clock.phase - match.channel.clock.phase) <
             0.5 * static_cast<double>(preamble.size()) * search.rows_per_chip;
    };
    if (apart.size() < search.max_matches && std::ranges::none_of(apart, overlaps)) apart.push_back(std::move(match));
  }
  return apart;
}

}  // namespace ocisac
