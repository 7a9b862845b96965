#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/chips/row_warp.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/receiver/row_reader.hpp"
#include "receiver/reading_trust.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

constexpr double kSlowLight = 260;                  // Hz; hum of mains of 50 and 60 Hz and its first harmonic
constexpr double kLowestHum = 90, kSameTone = 0.2;  // Hz; spectral lines of a frame
constexpr double kMinSlow = 2e-3;                   // min fraction of a signal's variance for slow light
constexpr double kHighestTone = 0.45;               // cycles per chip
constexpr std::array kExposureFactors{0.8, 1.2, 0.9, 1.1, 0.7, 1.35};  // of an exposure that is not right any more
constexpr double kPairErrors = 25;           // of the ratio of two pairs of rows, over 1 / the root of all rows
constexpr double kLeastChips = 24;           // in a part, before or after a pause
constexpr std::size_t kSearchedFactors = 2;  // in a frame, the next ones in another

// All rows, each frame's less its slow light.
std::vector<double> without_slow_light(std::span<const std::span<const double>> frames, double slow) {
  std::vector<double> all;
  for (const auto& signal : frames)
    if (const auto fit = remove_nuisance(signal, {slow, {}})) all.insert(all.end(), fit->rest.begin(), fit->rest.end());
  return all;
}

// (rows) g(d)·d of a FrameMixing.
std::vector<double> mixed_in(const FrameRows& frame, double gate) {
  const double mean = mean_of(frame.signal);
  std::vector<double> course(frame.signal.size());
  for (std::size_t n = 0; n < course.size(); ++n) {
    const double differs = frame.before[n] - (frame.signal[n] - mean);
    course[n] = std::clamp(2 - std::abs(differs) / gate, 0.0, 1.0) * differs;
  }
  return course;
}

// (4) Squared changes over 4 rows, summed over the pairs of rows that begin at each remainder of 4.
std::array<double, 4> changes_by_row(std::span<const double> signal, std::size_t first_row) {
  std::array<double, 4> changes{}, of_pairs{};
  for (std::size_t n = 0; n + 4 < signal.size(); ++n)
    changes[(first_row + n) % 4] += std::pow(signal[n + 4] - signal[n], 2);
  for (std::size_t k = 0; k < 4; ++k) of_pairs[k] = changes[k] + changes[(k + 1) % 4];
  return of_pairs;
}

// Cycles per row; where the chips are unknown, as if each took 1 / kHighestTone rows.
double highest_tone(const LightState& state) { return kHighestTone / state.rows_per_chip.value_or(1 / kHighestTone); }

}  // namespace

std::vector<double> unmixed(const FrameRows& frame, const FrameMixing& mixing) {
  std::vector<double> rows = mixed_in(frame, mixing.gate);
  for (std::size_t n = 0; n < rows.size(); ++n) rows[n] = frame.signal[n] - mixing.more * rows[n];
  return rows;
}

std::optional<FrameMixing> mixing_of(const FrameRows& frame, const RowsRead& best) {
  if (frame.before.empty() || !best.reading) return {};
  FrameReading reading = *best.reading;
  if (const auto predicted = best.state.predict(frame.time)) {
    ChipClock& clock = reading.channel.clock;
    const double moved = predicted->clock.phase - static_cast<double>(frame.first_row) - clock.phase;
    clock.phase += std::remainder(moved, clock.rows_per_chip);
    clock.rows_per_chip = predicted->clock.rows_per_chip;
    reading.warp.clear();
  }
  const auto chips = exposed_rows(reading, frame.signal.size());
  const auto& last = best.state.model.mixing;
  const auto now = remove_nuisance(last ? unmixed(frame, *last) : frame.signal, {}, chips);
  std::optional<FrameMixing> found;
  if (!now) return found;
  double least = kNearlyAll * now->residual_energy, largest = 0;
  for (const double differs : mixed_in(frame, kInfinity)) largest = std::max(largest, std::abs(differs));
  for (double gate = largest; gate > kSmallShare * largest; gate /= 2) {
    const auto course = mixed_in(frame, gate);
    const auto fit = remove_nuisance(frame.signal, {.before = course}, chips);
    if (!fit || !(fit->residual_energy < least)) continue;
    const double more =
        (scalar_product(frame.signal, course) - scalar_product(fit->rest, course)) / scalar_product(course, course);
    if (!(more > 0)) continue;
    found = FrameMixing{more, gate};
    least = fit->residual_energy;
  }
  return found;
}

std::optional<std::ptrdiff_t> longer_rows(const FrameRows& frame, const std::optional<FrameReading>& reading) {
  const auto changes = changes_by_row(frame.signal, frame.first_row);
  const auto least = static_cast<std::size_t>(std::ranges::min_element(changes) - changes.begin());
  const double by_chance = kPairErrors / std::sqrt(static_cast<double>(frame.signal.size()));
  const auto differ_by_more = [&](double ratio) {
    return changes[(least + 2) % 4] > (1 + by_chance) * ratio * changes[least];
  };
  if (!differ_by_more(1)) return std::nullopt;
  if (reading) {
    const auto of_chips = changes_by_row(exposed_rows(*reading, frame.signal.size()), frame.first_row);
    if (!differ_by_more(of_chips[(least + 2) % 4] / of_chips[least])) return std::nullopt;
  }
  return static_cast<std::ptrdiff_t>(least);
}

bool jumps_in_middle(const FrameRows& frame) {
  const auto squares = [&](std::size_t row) {
    double sum = 0;
    for (const auto& signal : frame.recent) sum += std::pow(signal[row] - signal[row - 1], 2);
    return sum;
  };
  const std::size_t middle = frame.signal.size() / 2;
  for (std::size_t row = 1; row < frame.signal.size(); ++row)
    if (row != middle && squares(row) >= squares(middle)) return false;
  return !frame.recent.empty();
}

bool clock_jumps(const FrameReading& reading, std::span<const double> signal) {
  if (reading.trust == Trust::fits || !reading.warp.empty()) return false;
  const ChipClock& clock = reading.channel.clock;
  const bool takes_up_jumps = clock.edge_std > 0 && reading.nuisance.empty();
  const auto off =
      fit_warp(takes_up_jumps ? signal : reading.rest, {}, {hard_chips(reading), reading.first}, reading.channel, true);
  const auto reach = static_cast<std::size_t>(kLeastChips * clock.rows_per_chip);
  std::optional<std::size_t> at;
  double most = kSamePhase * clock.rows_per_chip;
  for (std::size_t row = 0; row + reach < off.size(); ++row)
    if (const double move = std::abs(off[row + reach] - off[row]); move > most) {
      most = move;
      at = row;
    }
  return at && *at < off.size() / 2 && *at + reach > off.size() / 2;
}

std::optional<RowPause> RowReader::possible_pause(const FrameRows& frame, const LightState& state) const {
  const std::size_t middle = frame.signal.size() / 2;
  const double chip = state.rows_per_chip.value_or(0.0), exposure = state.model.exposure_rows.value_or(0.0);
  const bool is_long = chip > 0 && static_cast<double>(middle) >= kLeastChips * chip + exposure;
  if (state.model.pause || frame.first_row > 0 || !is_long) return {};
  return RowPause{.row = middle};
}

StrongestTone RowReader::prominent_tone(std::span<const double> signals, std::size_t rows,
                                        const LightState& state) const {
  const double highest = highest_tone(state);
  auto tone = strongest_tone(signals, rows, kLowestHum * camera_.row_time, highest);
  if (tone.prominence < kProminent) return {};
  for (const double mains : kMains)
    if (std::abs(mains * camera_.row_time - tone.frequency) * static_cast<double>(rows) < kSameTone)
      tone.frequency = mains * camera_.row_time;
  return tone;
}

// Slow light and tones that the rows show, the most likely first.
std::vector<RowNuisance> RowReader::other_nuisances(const FrameRows& frame, const RowsRead& best) const {
  const std::span<const double> signal = frame.signal;
  const LightState& state = best.state;
  const double slow = kSlowLight * camera_.row_time, row_time = camera_.row_time;
  const auto& scale = state.scale_beside;
  const auto fit = remove_nuisance(signal, {slow, {}, scale});
  const auto plain = remove_nuisance(signal, {});
  const double highest = highest_tone(state);
  std::vector<RowNuisance> nuisances;
  if (fit && plain && fit->residual_energy < (1 - kMinSlow) * plain->residual_energy) {
    for (const double mains : kMains)
      for (const std::size_t harmonics : {std::size_t{1}, std::size_t{3}})
        nuisances.push_back({0, {mains * row_time}, scale, harmonics});
    nuisances.push_back({slow, {}, scale});
  }
  if (fit && slow < highest) {
    const auto tone = strongest_tone(without_slow_light(frame.recent, slow), signal.size(), slow, highest);
    if (tone.prominence > kProminent) nuisances.push_back({0, {tone.frequency}, scale});
  }
  if (!frame.before.empty() && state.model.nuisance.before.empty()) {
    nuisances.push_back(state.model.nuisance);
    nuisances.back().before = frame.before;
  }
  // In order of Schwarz's criterion. Where an earlier frame was read, too, chips are mostly right: slow light and tones
  // must take up a part of what they leave.
  const auto chips = best.reading && state.channel ? exposed_rows(*best.reading, signal.size()) : std::vector<double>{};
  const auto beside = [&](const RowNuisance& nuisance) {
    const auto left = remove_nuisance(signal, nuisance, chips);
    return left ? left->residual_energy : 0.0;
  };
  const double without = chips.empty() ? 0.0 : kNearlyAll * beside({});
  std::vector<std::pair<double, std::size_t>> order;
  for (std::size_t k = 0; k < nuisances.size(); ++k) {
    const auto left = remove_nuisance(signal, nuisances[k]);
    const bool is_seen = chips.empty() || !nuisances[k].before.empty() || beside(nuisances[k]) < without;
    if (left && is_seen) order.emplace_back(schwarz_criterion(left->residual_energy, signal.size(), left->unknowns), k);
  }
  std::ranges::sort(order);
  std::vector<RowNuisance> sorted;
  for (const auto& [criterion, k] : order) sorted.push_back(std::move(nuisances[k]));
  return sorted;
}

// A pause in the middle of a lamp's rows that begin with the picture; then slow light, tones, the light's shape,
// displaced rows and other exposures: from the tracked clock, then, where chips are in doubt, by a search for another
// clock.
std::vector<Hypothesis> RowReader::hypotheses(const FrameRows& frame, const RowsRead& best) const {
  const LightState& state = best.state;
  SignalModel given = given_model(state.exposure);
  given.long_row = longer_rows(frame, best.reading);
  const SignalModel& last = state.model;
  const bool is_tracked = state.channel && state.fits;
  const bool is_sure = best.reading && best.reading->trust == Trust::sure, may_search = !is_sure && frame.may_search;
  std::vector<Hypothesis> all;
  const auto with = [](SignalModel model, auto member, auto value) {
    model.*member = std::move(value);
    return model;
  };
  if (best.reading && !is_sure && last.nuisance.empty())
    all.push_back({.model = with(last, &SignalModel::warped, true), .refines = true});
  const auto pause = may_search ? possible_pause(frame, state) : std::nullopt;
  const Hypothesis pausing{with(given, &SignalModel::pause, pause), true, true};
  if (pause && !given.long_row) all.push_back(pausing);
  std::vector<SignalModel> models;
  if (!last.nuisance.empty() || last.exposure_known != given.exposure_known || last.slow_light || last.loose_edges ||
      last.warped || last.pause || last.mixing || last.long_row != given.long_row)
    models.push_back(given);
  for (RowNuisance& nuisance : other_nuisances(frame, best))
    models.push_back(with(given, &SignalModel::nuisance, std::move(nuisance)));
  if (!last.slow_light) models.push_back(with(last, &SignalModel::slow_light, true));
  if (!last.loose_edges && !last.long_row) {
    models.push_back(with(last, &SignalModel::slow_light, false));
    models.back().loose_edges = true;
  }
  if (!last.warped) models.push_back(with(given, &SignalModel::warped, true));
  const double now = state.channel ? state.channel->clock.exposure_rows : given.exposure_rows.value_or(0.0);
  const std::size_t factors = kExposureFactors.size();
  for (const bool searches : {false, true}) {
    if (searches ? !may_search : !is_tracked) continue;
    for (const SignalModel& model : models) all.push_back({model, searches, model.loose_edges});
    const auto another_exposure = [&](std::optional<double> rows) {
      all.push_back({{.nuisance = last.nuisance, .exposure_rows = rows, .long_row = given.long_row}, searches});
    };
    if (given.exposure_rows) another_exposure({});                                    // a preamble may show it
    if (searches && state.channel && best.reading) continue;                          // that exposure is about right
    if (state.channel) another_exposure(state.brightness_ratio(frame.signal) * now);  // the brightness changed alike
    const std::size_t count = searches ? kSearchedFactors : factors;
    for (std::size_t k = 0; now > 0 && k < count; ++k)
      another_exposure(kExposureFactors[(state.other_models.failures * count + k) % factors] * now);
  }
  if (pause && given.long_row) all.push_back(pausing);  // rows of two exposures alone look so, too
  return all;
}

}  // namespace ocisac
