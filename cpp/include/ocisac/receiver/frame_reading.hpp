// The chips of one frame, soft, with the channel that they tell: from a channel that is nearly right, or from none.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/chips/refine_channel.hpp"

namespace ocisac {

struct FrameReading {
  ChannelEstimate channel;    // fitted to the chips
  std::vector<double> llr;    // (chips) ln P(bright)/P(dark), nats, of all chips that the rows see
  std::ptrdiff_t first = 0;   // number of the first of them on the channel's clock
  double error_rate = 1;      // expected, chips seen by a part of the exposure only left out
  double relative_noise = 0;  // standard deviation of a row over the swing in the middle of the frame
  bool even = false;          // no part of the frame is known to be explained worse than the others
};

// Detection and least squares in turn until the clock stays, from a channel that is nearly right; mostly once. Absent
// where the chips determine no channel, or the exposure is too long to detect.
std::optional<FrameReading> read_frame(std::span<const double> signal, const ChannelEstimate& start,
                                       bool exposure_known, SearchEffort* effort = nullptr);

struct FrameSearch {
  double rows_per_chip;                 // nominal
  double tolerance = 0.02;              // the true one lies within this share of it
  std::optional<double> exposure_rows;  // rows; absent: estimated
  std::span<const double> preamble;     // chips that may be in the frame
  SearchEffort* effort = nullptr;       // nullptr: no limit
};

// From a preamble, else from the rate alone. Absent where nothing is found that can be relied on.
std::optional<FrameReading> search_frame(std::span<const double> signal, const FrameSearch& search);

// The same from a channel that is right in a part of the frame; `known`: chips on its clock, a preamble.
std::optional<FrameReading> extend_reading(std::span<const double> signal, const ChannelEstimate& start,
                                           bool exposure_known, SearchEffort* effort = nullptr,
                                           const KnownChips& known = {});

// Chips of which few are expected to be wrong: hardly any, unless the channel explains all parts of the frame alike.
// Chips made of nothing but noise let expect that a fifth is wrong.
bool is_sound(const FrameReading& reading);

}  // namespace ocisac
