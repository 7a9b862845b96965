// The trust in a reading, and log-likelihood ratios that agree with what the channel leaves of the rows, and with the
// line code.
#pragma once

#include <span>
#include <vector>

#include "ocisac/packets/packets.hpp"
#include "ocisac/receiver/frame_reading.hpp"

namespace ocisac {

// Evidence and trust from the reading's channel, chips and rows. Sound: few chips are expected to be wrong, fewer
// still unless the channel explains all parts of the frame equally well. Sure: less than one
// chip in twenty frames, beside those near the frame's ends that only a part of the exposure covers.
// `off`: of its edges from the clock, as in PlacedEdges; empty where none may be.
void judge(FrameReading& reading, std::span<const double> off);

// True where edges off the clock explain the rows, if not as jitter: the clock may be another in a part of the frame.
bool fits_off_clock(const FrameReading& reading);

// True where the clock that a reading began with need not be searched: a misfit with few errors, or a fit.
bool keeps_clock(const FrameReading& reading);

// Number of wrong chips that ratios, times a scale, expect.
double expected_errors(std::span<const double> llr, double scale = 1);

inline constexpr double kMaxRelativeNoise = 1.0 / 3;  // of a frame that can be read, over the swing
inline constexpr double kNoResidual = 0.005;          // the same: rounding to whole values may be correlated
inline constexpr double kSamePhase = 0.1;             // chips, by which clocks differ without a wrong chip
inline constexpr double kAsNoisy = 1.2;               // ratio of what two readings leave that are as good
inline constexpr double kLessNoise = 0.8;             // the same, required of another model

// Those of a reading's chips. Where more is left than white noise, the noise is of unknown size, as Student's t has it:
//
//   ±2·ln(1 + |L|/(6·excess)) for a ratio L
//
// The factor of 6 is measured (docs/measured/field.md): chips are chosen so that little is left.
std::vector<double> reliable_llr(const FrameReading& reading);

// The run of a misfit's chips with few expected to be wrong that has most edges (darkness has none): beyond it the
// clock may be another one, so that chips may have other numbers. All where it is short.
RowRange explained_chips(std::span<const double> llr);

// Ratios by which the packet's code weighs a reading's chips. They keep sure and weak chips further apart than
// reliable_llr: rows whose residual is correlated by r count as (1 − r)/(1 + r) of independent ones.
std::vector<double> code_weights(const FrameReading& reading);

// Chips before, between and after the preambles that they show, without equal ones before a preamble: a sender that
// pauses there moves the places of words.
std::vector<std::span<const double>> coded_parts(std::span<const double> llr, const PacketFormat& format);

// Scales the ratios of consecutive chips towards 0 where more words violate the line code than they admit: until they
// expect as many wrong chips as the violations show. Chips of a preamble may violate it. Line code "none": as they are.
// True where they were not scaled.
bool agree_with_code(std::vector<double>& llr, const PacketFormat& format);

}  // namespace ocisac
