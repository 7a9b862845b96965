// Conditions that limit the validity of an estimate; bits of one mask.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace ocisac {

using Flags = std::uint32_t;

namespace flag {
inline constexpr Flags saturated = 1U << 0;          // samples at 98 % of white or more: gain is low or distorted
inline constexpr Flags near_null = 1U << 1;          // |sinc(f·T_e)| < 0.05: next to nothing of the tone is left
inline constexpr Flags weak = 1U << 2;               // amplitude below three standard errors: mostly noise
inline constexpr Flags few_cycles = 1U << 3;         // less than one cycle in the frame; two for a frequency search
inline constexpr Flags aliased = 1U << 4;            // tone above half the row rate, seen at its alias
inline constexpr Flags unresolvable = 1U << 5;       // a multiple of half the row rate, or too few rows: NaN
inline constexpr Flags no_light = 1U << 6;           // the source's mean is not above 0: NaN
inline constexpr Flags off_bin = 1U << 7;            // dft: the tone lies beside its bin, the gain is biased
inline constexpr Flags ill_conditioned = 1U << 8;    // the rows hardly tell the model's parts apart
inline constexpr Flags harmonics_dropped = 1U << 9;  // harmonics left out: too many for the rows, or on another tone
inline constexpr Flags no_tone = 1U << 10;           // search: nothing periodic stands out of the noise
inline constexpr Flags at_bound = 1U << 11;       // search: the best frequency is a bound; the true one may lie beyond
inline constexpr Flags no_signal = 1U << 16;      // receive: no chips found, no bits
inline constexpr Flags too_few_edges = 1U << 17;  // receive: too few changes of the light to be sure of the chip rate
inline constexpr Flags long_exposure = 1U << 18;  // receive: longer than a chip; the bits are not to be trusted
inline constexpr Flags periodic = 1U << 19;       // receive: one rise and one fall over and over; no data tell from it
// Harmonics that fit neither waveform nor exposure, another tone too near, or a light that varies along the column:
// tone_gain is biased. Receiver: more is left of the rows than noise; bits are
// less sure than their likelihoods.
inline constexpr Flags model_misfit = 1U << 24;
inline constexpr Flags quantised = 1U << 25;  // less noise than half a step: rounding may exceed the standard error
inline constexpr Flags ambiguous_motion = 1U << 26;  // sense: several motions show the same rows
inline constexpr Flags ambiguous_kind = 1U << 27;    // sense, receive: a light and a (still) texture would look alike
}  // namespace flag

// Name of a single bit; null for any other mask.
const char* flag_name(Flags bit);

// Names of the bits that are set.
std::vector<std::string> flag_names(Flags flags);

}  // namespace ocisac
