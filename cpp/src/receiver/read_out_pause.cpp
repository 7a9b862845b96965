#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "ocisac/receiver/row_reader.hpp"
#include "receiver/reading_trust.hpp"

namespace ocisac {

namespace {

constexpr double kFrameSays = 4;  // nats, at most, of a frame, which may be read wrong

// Levels at the last row, for the rows after it; the clock's phase counts from row `begin`.
ChannelEstimate continued(ChannelEstimate channel, std::size_t rows, double begin) {
  const auto last = static_cast<double>(rows) - 1;
  const double dark = channel.dark_at(last, rows), swing = channel.swing_at(last, rows);
  std::ranges::fill(channel.dark, 0.0);
  std::ranges::fill(channel.swing, 0.0);
  channel.dark[0] = dark;
  channel.swing[0] = swing;
  channel.clock.phase -= begin;
  return channel;
}

// The state after a frame or a part of one, whose channel is to be followed without a clock.
LightState known(const FrameReading& part, std::span<const double> signal, LightState state) {
  state.tracker.reset();
  state.accept(part, signal);
  state.fits = part.trust == Trust::fits;
  state.relative_noise = part.relative_noise;
  return state;
}

// Adds the second part to the first, on the clock of the first. `chips`: from its chip 0 to that of the second part.
// Returns the evidence, in nats, that chips that both see are the same.
double join(FrameReading& first, const FrameReading& second, std::ptrdiff_t chips) {
  const std::ptrdiff_t begin = second.first + chips - first.first;
  const auto size = static_cast<std::size_t>(std::max(begin + std::ssize(second.llr), std::ssize(first.llr)));
  first.after_pause = std::min(second.first + chips, first.first + std::ssize(first.llr));
  first.llr.resize(size);
  first.excess.resize(size, 1.0);
  double evidence = 0;
  for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(-begin, 0); k < std::ssize(second.llr); ++k) {
    const auto at = static_cast<std::size_t>(begin + k), from = static_cast<std::size_t>(k);
    const double a = std::tanh(0.5 * first.llr[at]), b = std::tanh(0.5 * second.llr[from]);
    evidence += std::max(std::log1p(a * b), -kSureChip);  // ln(P(same) / ½)
    first.llr[at] += second.llr[from];
    first.excess[at] = std::max(first.excess[at], second.excess[from]);
  }
  first.rest.insert(first.rest.end(), second.rest.begin(), second.rest.end());
  first.trust = std::min(first.trust, second.trust);
  first.error_rate = std::max(first.error_rate, second.error_rate);
  first.relative_noise = std::max(first.relative_noise, second.relative_noise);
  first.correlation = std::max(first.correlation, second.correlation);
  return evidence;
}

}  // namespace

std::size_t RowPause::chips() const {
  return static_cast<std::size_t>(std::ranges::max_element(evidence) - evidence.begin());
}

double RowPause::sureness() const {
  double others = 0;  // probability over that of the most likely count
  for (const double other : evidence) others += std::exp(other - evidence[chips()]);
  others -= 1;
  return std::log((2 + others) / std::max(others, 1e-300));
}

LightState RowReader::about_pause(const RowsRead& best, const FrameRows& frame) const {
  const LightState state = restarted(best.state);
  return best.reading ? known(*best.reading, frame.signal, state) : state;
}

bool RowPause::loses_chips() const { return evidence[0] <= -kFrameSays; }
bool RowPause::loses_none() const { return *std::max_element(evidence.begin() + 1, evidence.end()) <= -kFrameSays; }

// Each part is read from the channel of the other where that one fits; where the pause is new, both must be sure, or
// the light must jump there.
std::optional<FrameReading> RowReader::read_about(const RowPause& pause, const SignalModel& model, FrameRows& frame,
                                                  const LightState& state) const {
  if (pause.row <= frame.first_row || pause.row >= frame.first_row + frame.signal.size()) return std::nullopt;
  const std::size_t cut = pause.row - frame.first_row;
  const bool is_new = !pause.rows;
  SignalModel even = model;
  even.pause.reset();
  FrameRows before = part_of(frame, {0, cut}), after = part_of(frame, {cut, frame.signal.size()});
  before.may_follow = after.may_follow = true;
  auto first = read_with(even, before, state);
  if (!first && !is_new) return std::nullopt;
  LightState late = state;
  if (first && (!is_new || first->trust == Trust::fits)) {
    late = known(*first, after.signal, state);
    late.channel = continued(first->channel, cut, static_cast<double>(cut) + pause.rows.value_or(0.0));
  }
  after.effort = before.effort;
  const auto second = read_with(even, after, late);
  frame.effort = after.effort;
  if (is_new && second && second->trust == Trust::fits && !(first && first->trust == Trust::fits))
    first = read_with(even, before, known(*second, before.signal, state));
  const Trust least = is_new && jumps_in_middle(frame) ? Trust::misfit : Trust::sure;
  if (is_new && !(first && first->trust >= least)) return std::nullopt;
  RowPause now = pause;
  bool joins = second && second->trust >= least;
  if (is_new && !joins) return std::nullopt;
  std::ptrdiff_t chips = 0;
  if (joins) {
    const double chip = first->channel.clock.rows_per_chip;
    double to_second = second->channel.clock.phase + static_cast<double>(cut) - first->channel.clock.phase;
    if (!first->warp.empty()) to_second += first->warp.back();
    if (!second->warp.empty()) to_second -= second->warp.front();
    if (is_new) now.rows = std::max(std::ceil(to_second / chip - kSamePhase) * chip - to_second, 0.0);
    chips = static_cast<std::ptrdiff_t>(std::nearbyint((to_second + *now.rows) / chip));
    FrameReading doubted = *second;
    doubted.llr = reliable_llr(*second);
    std::array<double, RowPause::kMostChips> evidence{};
    for (std::size_t lost = 0; lost < evidence.size(); ++lost) {
      FrameReading joined = *first;
      joined.llr = reliable_llr(*first);
      evidence[lost] = join(joined, doubted, chips + static_cast<std::ptrdiff_t>(lost));
      for (double& llr : joined.llr) llr = std::clamp(llr, -kSureChip, kSureChip);
      for (const auto part : coded_parts(joined.llr, options_.format))
        evidence[lost] += options_.format.line_code.evidence_anywhere(part);
    }
    const double most = *std::ranges::max_element(evidence);
    for (std::size_t lost = 0; lost < evidence.size(); ++lost)
      now.evidence[lost] += std::max(evidence[lost] - most, -kFrameSays);
    joins = evidence[now.chips()] > most - kFrameSays;  // else a part's clock is a chip off in this frame
  }
  if (joins) {
    join(*first, *second, chips + static_cast<std::ptrdiff_t>(now.chips()));
  } else {
    first->rest.insert(first->rest.end(), after.signal.begin(), after.signal.end());
    first->trust = std::min(first->trust, Trust::misfit);
    first->after_pause = first->first + std::ssize(first->llr);
  }
  first->pause = now;
  return first;
}

}  // namespace ocisac
