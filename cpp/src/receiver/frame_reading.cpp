#include "ocisac/receiver/frame_reading.hpp"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "chips/chip_period.hpp"
#include "chips/edge_places.hpp"
#include "core/levels.hpp"
#include "ocisac/chips/detect_chips.hpp"
#include "ocisac/chips/preamble.hpp"
#include "ocisac/chips/refine_channel.hpp"
#include "receiver/reading_trust.hpp"

namespace ocisac {

namespace {

constexpr int kMinRounds = 3;       // of detection, until the channel stays
constexpr double kSettling = 0.98;  // ratio of the residual to that of the round before, for more than three
// Chips at either end of the frame; of the exposure; levels relative to the swing; standard errors of a step in vain.
constexpr double kStays = 0.02;
constexpr double kRestStays = 0.3;  // relative to the noise, of the rows less slow light and tones
constexpr std::size_t kPreamblesTried = 3;
constexpr double kLongestPreambleExposure = 14;  // chips

double middle_swing(const ChannelEstimate& channel, std::size_t rows) {
  return channel.swing_at(0.5 * static_cast<double>(rows), rows);
}

// Preconditions of the detectors.
bool detectable(std::span<const double> signal, const ChannelEstimate& channel) {
  const ChipClock& clock = channel.clock;
  const auto swing = [&](std::size_t row) { return channel.swing_at(static_cast<double>(row), signal.size()); };
  bool bright = std::isfinite(channel.noise);
  for (std::size_t row = 0; row < signal.size(); ++row) bright = bright && std::isfinite(signal[row]) && swing(row) > 0;
  return bright && std::isfinite(clock.phase) && clock.rows_per_chip > 0 && clock.exposure_rows >= 0 &&
         clock.exposure_rows <= kLongestReducedExposure * clock.rows_per_chip;
}

// Longest exposure in chips at which the full trellis costs less than the reduced search: for read_frame, where few
// sequences are likely, and for a search, where wrong channels make all sequences likely.
constexpr double kLongestSlowTrellis = 9, kLongestTrellis = 6, kLongestSearchedTrellis = 10.5;

std::string_view method_for(const ChipClock& clock, double longest_trellis) {
  if (clock.edge_std > 0) return "reduced";            // only the equations have the noise of edges
  const bool slow = clock.rise > 0 || clock.fall > 0;  // only the full trellis models them
  const double longest = slow ? kLongestSlowTrellis : longest_trellis;
  return clock.exposure_rows <= longest * clock.rows_per_chip ? "mlse" : "reduced";
}

// Fails, so that the channel is rejected, where the estimated exposure is too long.
std::vector<double> detect_levels(const ChipQuestion& question) {
  return level_detector(method_for(question.clock, kLongestSearchedTrellis))(question);
}

// True if detection with one channel is equivalent to that with the other.
bool is_same(const ChannelEstimate& a, const ChannelEstimate& b, std::size_t rows) {
  const auto last = static_cast<double>(rows);
  const auto chips_off = [&](double row) {
    const auto chip_of = [row](const ChipClock& clock) { return (row - clock.phase) / clock.rows_per_chip; };
    return std::abs(chip_of(a.clock) - chip_of(b.clock));
  };
  // Deviations of the mean level and of the swing, weighted by the spread of the rows about the mean for random chips.
  const double swing = middle_swing(b, rows);
  const double spread = 0.5 / std::sqrt(std::max(b.clock.exposure_rows / b.clock.rows_per_chip, 1.0));
  const auto levels_off = [&](double row) {
    const double dark = a.dark_at(row, rows) - b.dark_at(row, rows);
    const double taller = a.swing_at(row, rows) - b.swing_at(row, rows);
    return std::max(std::abs(dark + 0.5 * taller), spread * std::abs(taller)) / swing;
  };
  const double middle = 0.5 * last;
  return chips_off(0) < kStays && chips_off(last) < kStays &&
         std::abs(a.clock.exposure_rows - b.clock.exposure_rows) <= kStays * b.clock.exposure_rows &&
         std::max({levels_off(0), levels_off(middle), levels_off(last)}) < kStays;
}

// Slow light and tones, fitted beside the chips of a round of detection and removed from a reading's rows.
class FittedBeside {
 public:
  // Returns the root mean square of the change of the reading's rows: none beside the same chips, where the tones stay.
  std::optional<double> take(std::span<const double> signal, const KnownChips& chips, const ChannelEstimate& channel,
                             FrameReading& reading) {
    if (reading.first == first_ && std::ranges::equal(chips.levels, chips_) &&
        moved_by_steps_ <= kRestStays * channel.noise)
      return 0.0;
    std::vector<double>& rest = reading.rest;
    std::vector<double> exposed(rest.size());
    expose_chips(chips, channel.clock, exposed);
    auto fit = remove_nuisance(signal, reading.nuisance, exposed);
    if (!fit) return std::nullopt;
    const double reach = kToneReach / static_cast<double>(rest.size());
    for (std::size_t k = 0; k < reading.nuisance.tones.size(); ++k)
      reading.nuisance.tones[k] += std::clamp(fit->tone_steps[k], -reach, reach);
    double squares = 0;
    for (std::size_t n = 0; n < rest.size(); ++n) squares += std::pow(fit->rest[n] - rest[n], 2);
    rest = std::move(fit->rest);
    chips_.assign(chips.levels.begin(), chips.levels.end());
    first_ = reading.first;
    moved_by_steps_ = fit->moved_by_steps;
    return std::sqrt(squares / static_cast<double>(rest.size()));
  }
  // The channel is another one.
  void forget() { chips_.clear(); }

 private:
  std::vector<double> chips_;
  std::ptrdiff_t first_ = 0;
  double moved_by_steps_ = 0;
};

}  // namespace

std::vector<double> hard_chips(const FrameReading& reading) {
  std::vector<double> chips(reading.llr.size());
  std::ranges::transform(reading.llr, chips.begin(), [](double llr) { return llr > 0 ? 1.0 : 0.0; });
  return chips;
}

std::optional<FrameReading> read_frame(std::span<const double> signal, const ChannelEstimate& start,
                                       bool exposure_known, SearchEffort* effort, const RowsBeside* beside) {
  const ChannelModel model{start.dark.size() - 1, start.swing.size() - 1, exposure_known, 0, kStays};
  ChannelEstimate channel = start;
  FrameReading reading;
  reading.rest.assign(signal.begin(), signal.end());
  if (beside) reading.nuisance = beside->nuisance;
  FittedBeside fitted_beside;
  PlacedEdges edges;
  for (int round = 0; round < kMaxIterations; ++round) {
    if (!detectable(reading.rest, channel)) return std::nullopt;
    const ChipRows rows(reading.rest, channel);
    const ChipQuestion question = rows.question();
    reading.llr = detect_chips(question, method_for(question.clock, kLongestTrellis)).llr;
    reading.first = question.first;
    const auto chips = hard_chips(reading);
    const auto moved = beside ? fitted_beside.take(beside->signal, {chips, reading.first}, channel, reading) : 0.0;
    if (round == 0 && moved && *moved > kRestStays * channel.noise) continue;  // its rows will be read again
    auto fitted =
        moved ? fit_channel(reading.rest, {chips, reading.first}, channel.clock, model, effort) : std::nullopt;
    if (!fitted) return std::nullopt;
    if (channel.clock.edge_std > 0) edges = place_edges(reading.rest, {chips, reading.first}, *fitted);
    const bool stays = (is_same(channel, *fitted, signal.size()) && *moved <= kRestStays * fitted->noise) ||
                       (round + 1 >= kMinRounds && !(fitted->noise < kSettling * channel.noise));
    channel = std::move(*fitted);
    fitted_beside.forget();
    reading.relative_noise = channel.noise / std::max(middle_swing(channel, signal.size()), 1e-300);
    // Rescale the likelihoods from the assumed to the estimated noise.
    const double weight = std::pow(question.noise / std::max(reading.relative_noise, kMinDetectorNoise), 2);
    for (double& llr : reading.llr) llr *= weight;
    if (stays) break;
  }
  reading.channel = std::move(channel);
  if (!edges.rest.empty()) reading.rest = std::move(edges.rest);
  judge(reading, edges.off);
  return reading;
}

std::vector<double> exposed_rows(const FrameReading& reading, std::size_t rows) {
  const auto chips = hard_chips(reading);
  std::vector<double> exposed(rows);
  expose_chips({chips, reading.first}, reading.channel.clock, exposed);
  return warped(exposed, reading.warp);
}

ChipGrid whole_chips(const FrameReading& reading, std::size_t rows) {
  ChipGrid whole = whole_chips(reading.channel.clock, rows);
  const std::ptrdiff_t end =
      std::min(whole.first + static_cast<std::ptrdiff_t>(whole.count), reading.first + std::ssize(reading.llr));
  whole.first = std::min(std::max(whole.first, reading.first), end);
  whole.count = static_cast<std::size_t>(end - whole.first);
  return whole;
}

std::vector<std::uint8_t> whole_bits(const FrameReading& reading, std::size_t rows) {
  const ChipGrid whole = whole_chips(reading, rows);
  std::vector<std::uint8_t> bits;
  for (std::size_t k = 0; k < whole.count; ++k)
    bits.push_back(reading.llr[static_cast<std::size_t>(whole.first - reading.first) + k] > 0);
  return bits;
}

FrameReading with_shortest_exposure(FrameReading reading, SearchEffort* effort) {
  const auto start = with_shortest_exposure(reading.channel, whole_bits(reading, reading.rest.size()));
  auto shorter = start ? read_frame(reading.rest, *start, false, effort) : std::nullopt;
  if (!shorter || !(shorter->channel.noise < kAsNoisy * reading.channel.noise)) return reading;
  shorter->warp = std::move(reading.warp);
  shorter->nuisance = std::move(reading.nuisance);
  return std::move(*shorter);
}

namespace {

// Soft chips for the result of refine_channel.
std::optional<FrameReading> reading_of(std::span<const double> signal, const std::optional<RefinedChannel>& found,
                                       bool exposure_known, SearchEffort* effort) {
  if (!found) return std::nullopt;
  auto reading = read_frame(unwarped(signal, found->warp), found->channel, exposure_known, effort);
  if (!reading) return std::nullopt;
  reading->warp = found->warp;
  return reading;
}

}  // namespace

std::optional<FrameReading> extend_reading(std::span<const double> signal, const ChannelEstimate& start,
                                           bool exposure_known, SearchEffort* effort, const KnownChips& known,
                                           bool warped) {
  const RefineOptions options{.exposure_known = exposure_known, .known = known, .effort = effort, .warped = warped};
  return reading_of(signal, refine_channel(signal, start, detect_levels, options), exposure_known, effort);
}

std::optional<FrameReading> search_frame(std::span<const double> signal, const FrameSearch& search) {
  const double longest_allowed = kLongestReducedExposure * (1 - search.tolerance) * search.rows_per_chip;
  if (search.exposure_rows && *search.exposure_rows > longest_allowed) return std::nullopt;
  const bool exposure_known = search.exposure_rows.has_value();
  const auto acceptable = [&](std::optional<FrameReading> reading) {
    if (reading && search.warped) reading = refine_warp(signal, std::move(*reading), exposure_known, search.effort);
    const Trust least = search.warped ? Trust::fits : Trust::misfit;
    return reading && reading->has_rate(search.rows_per_chip) && reading->trust >= least ? std::move(reading)
                                                                                         : std::nullopt;
  };
  const double chips = static_cast<double>(search.preamble.size());
  const double seen = chips - search.exposure_rows.value_or(0.0) / search.rows_per_chip;
  if (seen >= kMinChipsSeen) {
    const auto matches = find_preamble(signal, search.preamble,
                                       {.rows_per_chip = search.rows_per_chip,
                                        .tolerance = search.tolerance,
                                        .exposure_rows = search.exposure_rows,
                                        .max_exposure_chips = std::min(kLongestPreambleExposure, chips - kMinChipsSeen),
                                        .max_matches = kPreamblesTried});
    for (const auto& match : matches) {
      if (auto reading = acceptable(extend_reading(signal, match.channel, exposure_known, search.effort,
                                                   {search.preamble, 0}, search.warped)))
        return reading;
    }
  }
  if (!search.blind) return std::nullopt;
  const ChannelSearch blind{
      .rows_per_chip = search.rows_per_chip, .tolerance = search.tolerance, .exposure_rows = search.exposure_rows};
  const RefineOptions options{.exposure_known = exposure_known, .effort = search.effort, .warped = search.warped};
  return acceptable(
      reading_of(signal, find_channel(signal, blind, detect_levels, options), exposure_known, search.effort));
}

}  // namespace ocisac
