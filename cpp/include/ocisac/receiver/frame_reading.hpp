// Soft chips and channel of one frame, from an approximate channel or without one.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/chips/refine_channel.hpp"
#include "ocisac/chips/row_nuisance.hpp"
#include "ocisac/chips/row_warp.hpp"

namespace ocisac {

// Signal-to-noise ratio below which a light is flagged as weak: that of a swing of ±3 standard deviations.
inline constexpr double kWeakSnr = 9;
inline constexpr double kMaxSnr = 1e12;
inline constexpr double kToneReach = 0.25;         // by which a tone moves in a round, spectral lines of a frame
inline constexpr double kRowTimeTolerance = 0.08;  // relative, of a rate: the row time may be wrong

// Trust in a frame's reading, ascending.
enum class Trust {
  unsound,  // its chips may be those of noise or of another clock
  misfit,   // more than noise is left: chips are wrong, or something in the rows is in no model
  sure,     // more than noise is left, too little to put a chip in doubt
  fits,     // no more than noise is left
};

// The read-out of the rows from `row` of the picture on is late by `rows`, a part of a chip, and a count of chips.
struct RowPause {
  static constexpr std::size_t kMostChips = 8;
  std::size_t row = 0;
  std::optional<double> rows{};               // absent: to be found
  std::array<double, kMostChips> evidence{};  // nats, of all frames so far for each count

  [[nodiscard]] std::size_t chips() const;  // the most likely count
  [[nodiscard]] bool loses_chips() const;   // none lost is as unlikely as a frame can say
  [[nodiscard]] bool loses_none() const;    // all else is
  [[nodiscard]] double sureness() const;    // nats, of a chip after it: half of the chips of a wrong count are wrong
};

// With the evidence for its trust (receiver/reading_trust.cpp).
struct FrameReading {
  Trust trust = Trust::unsound;
  ChannelEstimate channel;   // fitted to the chips
  std::vector<double> llr;   // (chips) ln P(bright)/P(dark), nats, for all chips that affect the rows
  std::ptrdiff_t first = 0;  // index of the first one on the channel's clock
  double error_rate = 1;  // expected, without the chips near the frame's ends that only a part of the exposure covers
  double relative_noise = 0;    // standard deviation of a row over the swing at the middle row
  double correlation = 0;       // of what the channel leaves, from one row to the next: about 0 where it is noise
  double edge_correlation = 0;  // of the distances of edges off the clock, from one to the next: the same
  std::vector<double> excess;  // (chips) of the residual about a chip over white noise: its llr is too large by as much
  bool clock_in_doubt = false;  // more than noise is left everywhere, or edges lie anywhere: it may be another one
  std::optional<RowPause> pause{};
  std::ptrdiff_t after_pause = 0;  // its first chip
  RowWarp warp{};                  // of the picture's rows; the channel and the chips are those of the even rows
  std::vector<double> rest{};      // (rows) the rows that were read, less slow light and tones
  RowNuisance nuisance{};          // these, the tones where they leave least

  // The rate is that expected, as far as the row time may be wrong.
  [[nodiscard]] bool has_rate(double rows_per_chip) const {
    return std::abs(channel.clock.rows_per_chip / rows_per_chip - 1) < kRowTimeTolerance;
  }
};

// Rows with slow light and tones, which are fitted beside the chips; nearby tones are found.
struct RowsBeside {
  std::span<const double> signal;
  const RowNuisance& nuisance;
};

// Alternates detection and least squares, from an approximate channel until the clock converges; one round is usual.
// `beside`: the same rows with slow light and tones, which are about removed from `signal`.
// Absent where the chips determine no channel, or the exposure is too long for detection.
std::optional<FrameReading> read_frame(std::span<const double> signal, const ChannelEstimate& start,
                                       bool exposure_known, SearchEffort* effort = nullptr,
                                       const RowsBeside* beside = nullptr);

struct FrameSearch {
  double rows_per_chip;                 // nominal
  double tolerance = 0.02;              // max relative error of rows_per_chip
  std::optional<double> exposure_rows;  // rows; absent: estimated
  std::span<const double> preamble;     // chips expected in the frame
  SearchEffort* effort = nullptr;       // nullptr: no limit
  bool warped = false;                  // the rows may be displaced
  bool blind = true;                    // without a preamble, too
};

// Searches with a preamble, then blind with the rate. Absent without a reliable result.
std::optional<FrameReading> search_frame(std::span<const double> signal, const FrameSearch& search);

// The same from a channel that is valid in a part of the frame; `known`: chips on its clock, a preamble.
std::optional<FrameReading> extend_reading(std::span<const double> signal, const ChannelEstimate& start,
                                           bool exposure_known, SearchEffort* effort = nullptr,
                                           const KnownChips& known = {}, bool warped = false);

// 0 and 1.
std::vector<double> hard_chips(const FrameReading& reading);

// s_n of all rows of the picture by a reading's chips.
std::vector<double> exposed_rows(const FrameReading& reading, std::size_t rows);

// A reading again, of the rows less slow light and tones that are fitted beside its chips; tones that are nearly right
// move to where they leave least. Absent as read_frame.
std::optional<FrameReading> refine_nuisance(std::span<const double> signal, FrameReading reading, RowNuisance nuisance,
                                            bool exposure_known, SearchEffort* effort = nullptr);

// A reading again with the light's rise and fall, from those of its clock on: alternates detection and Gauss–Newton.
// Absent as read_frame.
std::optional<FrameReading> refine_shape(std::span<const double> signal, FrameReading reading, bool exposure_known,
                                         SearchEffort* effort = nullptr);

// A reading that more than noise is left of again, of displaced rows: alternates detection and the warp that explains
// the residual. The warp is believed where it explains a fifth of it; otherwise the reading as it is.
FrameReading refine_warp(std::span<const double> signal, FrameReading reading, bool exposure_known,
                         SearchEffort* effort = nullptr);

// A reading of the rows of the longer of two exposures again, of all rows, from the share of the shorter one on that
// explains most. Absent as read_frame.
std::optional<FrameReading> refine_turns(std::span<const double> signal, const FrameReading& reading,
                                         std::ptrdiff_t long_row, bool exposure_known, SearchEffort* effort = nullptr);

// Rows of a light that rises and falls with a time constant of `rows`, as if it did so at once: y + rows·dy/dn, by
// central differences. The light of equal rise and fall L obeys chips = L + τ·dL/dt, which the exposure keeps.
std::vector<double> sharpened(std::span<const double> signal, double rows);

// A reading of periodic chips again with the shortest exposure that explains it: their rows do not determine the
// exposure. Other readings as they are.
FrameReading with_shortest_exposure(FrameReading reading, SearchEffort* effort = nullptr);

// The reading's chips that lie whole in `rows` rows, and their bits.
ChipGrid whole_chips(const FrameReading& reading, std::size_t rows);
std::vector<std::uint8_t> whole_bits(const FrameReading& reading, std::size_t rows);

}  // namespace ocisac
