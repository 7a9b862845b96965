#include "ocisac/receiver/fsk_receiver.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"
#include "ocisac/receiver/frame_reading.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

constexpr double kChance = 0.1;       // probability that a frame of noise passes as a symbol
constexpr std::int64_t kBridged = 8;  // longest gap in frames across which a preamble is searched

}  // namespace

FskReceiver::FskReceiver(const Camera& camera, std::vector<double> tones, std::size_t block_bytes, Preamble preamble)
    : camera_(camera), tones_(std::move(tones)), assembler_({LineCode::named("none"), block_bytes, preamble}) {
  check_tones(camera_, tones_);
  if (!camera_.exposure) return;
  for (const double tone : tones_)
    require(std::abs(sinc(tone * *camera_.exposure)) >= kNearNull, "tones", tone,
            "tones of which the exposure of " + shortest_text(*camera_.exposure) +
                " s leaves 5 % or more: none near a multiple of " + shortest_text(1 / *camera_.exposure) + " Hz");
}

// Adds the bits at their place; frames in a short gap give erased bits.
void FskReceiver::take(FskFrame& result) {
  const auto bits = static_cast<std::int64_t>(demodulator_->bits());
  const std::int64_t unseen = last_ ? frames_between(*last_, result.frame) - 1 : 0;
  const std::int64_t bridged = unseen <= kBridged ? unseen : 0;
  std::vector<double> llr(static_cast<std::size_t>(bridged * bits), 0.0);
  llr.insert(llr.end(), result.symbol->llr.begin(), result.symbol->llr.end());
  result.stretch = assembler_.push((result.frame - bridged) * bits, llr);
  last_ = result.frame;
}

FskFrame FskReceiver::push(std::span<const AnyFramesView> colours, std::optional<std::int64_t> frame) {
  FskFrame result;
  result.frame = frame.value_or(order_.next());
  const auto lengths = lengths_of(colours);
  const auto admitted = order_.admit(result.frame, lengths);
  result.outcome = admitted.outcome;
  result.missing = admitted.missing;
  if (admitted.outcome != FrameOutcome::received) return result;
  if (admitted.restarts) {
    assembler_.lose_clock();
    last_.reset();
  }
  if (!are_numbers(colours)) {
    result.outcome = FrameOutcome::not_finite;
    return result;
  }
  if (!demodulator_ || rows_ != lengths[1]) demodulator_.emplace(camera_, tones_, lengths[1]);
  rows_ = lengths[1];
  const auto [column, colour] = best_column(colours, camera_.tone_curve);
  result.colour = colour;
  if (column.saturated) result.flags |= flag::saturated;
  auto symbol = demodulator_->demodulate(column.signal);
  if (!(symbol.snr > std::log(static_cast<double>(tones_.size()) / kChance))) {
    result.outcome = FrameOutcome::no_signal;
    result.flags |= flag::no_signal;
    return result;
  }
  if (symbol.snr < kWeakSnr) result.flags |= flag::weak;
  result.symbol = std::move(symbol);
  take(result);
  return result;
}

}  // namespace ocisac
