// Conditions that limit the validity of an estimate; bits of one mask.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace ocisac {

using Flags = std::uint32_t;

namespace flag {
enum Flag : Flags {
  saturated = 1U << 0,          // samples at 98 % of white or more: gain is low or distorted
  near_null = 1U << 1,          // |sinc(f·T_e)| < 0.05: next to nothing of the tone is left
  weak = 1U << 2,               // amplitude below three standard errors: mostly noise
  few_cycles = 1U << 3,         // less than one cycle in the frame; two for a frequency search
  aliased = 1U << 4,            // tone above half the row rate, seen at its alias
  unresolvable = 1U << 5,       // a multiple of half the row rate, or too few rows: NaN
  no_light = 1U << 6,           // the source's mean is not above 0: NaN
  off_bin = 1U << 7,            // dft: the tone lies beside its bin, the gain is biased
  ill_conditioned = 1U << 8,    // the rows hardly tell the model's parts apart
  harmonics_dropped = 1U << 9,  // harmonics left out: too many for the rows, or on another tone
  no_tone = 1U << 10,           // search: nothing periodic stands out of the noise
  at_bound = 1U << 11,          // search: the best frequency is a bound; the true one may lie beyond
  no_signal = 1U << 16,         // receive: no chips found, no bits
  too_few_edges = 1U << 17,     // receive: too few changes of the light to be sure of the chip rate
  long_exposure = 1U << 18,     // receive: longer than a chip; the bits are not to be trusted
  periodic = 1U << 19,          // receive: one rise and one fall over and over; no data tell from it
  // Harmonics that fit neither waveform nor exposure, another tone too near, or a light that varies along the column:
  // tone_gain is biased. Receiver: more is left of the rows than noise; bits are
  // less sure than their likelihoods.
  model_misfit = 1U << 24,
  quantised = 1U << 25,         // less noise than half a step: rounding may exceed the standard error
  ambiguous_motion = 1U << 26,  // sense: several motions show the same rows
  ambiguous_kind = 1U << 27,    // sense, receive: a light and a (still) texture would look alike
};
}  // namespace flag

constexpr Flags flag_if(bool condition, Flags bit) { return condition ? bit : 0; }

// Name of a single bit; null for any other mask.
const char* flag_name(Flags bit);

// Names of the bits that are set.
std::vector<std::string> flag_names(Flags flags);

}  // namespace ocisac
