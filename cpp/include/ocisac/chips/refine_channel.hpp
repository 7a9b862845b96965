// The channel of a whole frame, from a channel known in a part of it or from nothing but a nominal chip rate: detection
// of chips and least squares on them in turn.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"

namespace ocisac {

// What a detector is asked: the chips first, first + 1, … that consecutive rows see, all of them.
struct ChipQuestion {
  std::span<const double> rows;  // 0: steady dark, 1: steady bright
  ChipClock clock;               // phase relative to the first of `rows`
  double noise;                  // standard deviation of `rows`
  std::ptrdiff_t first;
  std::size_t count;
  KnownChips known{};  // of these chips, or others: `reduced` and `mlse` go through them, others may pass them over
};

// One level (0 or 1) a chip.
using DetectChips = std::function<std::vector<double>(const ChipQuestion&)>;

struct RefineOptions {
  bool exposure_known = false;
  std::size_t highest_degree = 4;  // of dark and swing along the frame; the data decide up to it (Schwarz's criterion)
  KnownChips known{};              // chips that need not be detected: a preamble
  SearchEffort* effort = nullptr;  // where it is used up, what was found so far is the answer; nullptr: no limit
};

struct RefinedChannel {
  ChannelEstimate channel;
  std::vector<double> chips;  // of the whole frame
  std::ptrdiff_t first = 0;   // number of the first of them
  bool settled = false;       // the last detection changed none of them
  bool even = false;          // no part of the frame is explained worse than the others: the clock was not lost there
};

// From the rows where the channel was found outwards, only as far at a time as its clock is sure, to the whole frame.
// Absent where the chips found do not determine a channel.
std::optional<RefinedChannel> refine_channel(std::span<const double> signal, const ChannelEstimate& start,
                                             const DetectChips& detect, const RefineOptions& options = {});

struct ChannelSearch {
  double rows_per_chip;                 // nominal
  double tolerance = 0.02;              // the true one lies within this share of it
  std::optional<double> exposure_rows;  // rows; absent: estimated
  double max_exposure_chips = 7;        // chips, where it is estimated
};

// The channel without a preamble: several phases, rates and exposures as starts on a short part of the frame; the one
// whose chips leave the least residual is refined over the frame. Absent where no start leads to a channel.
std::optional<RefinedChannel> find_channel(std::span<const double> signal, const ChannelSearch& search,
                                           const DetectChips& detect, const RefineOptions& options = {});

}  // namespace ocisac
