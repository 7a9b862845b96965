// Channel of a whole frame from a channel valid in a part of it, or from a nominal chip rate: alternates chip detection
// and least squares.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/chips/row_warp.hpp"

namespace ocisac {

// Smallest noise that detectors assume, relative to the swing.
inline constexpr double kMinDetectorNoise = 1e-4;

// Input of a detector: all chips first, first + 1, … that affect consecutive rows.
struct ChipQuestion {
  std::span<const double> rows;  // 0: steady dark, 1: steady bright
  ChipClock clock;               // phase relative to the first of `rows`
  double noise;                  // standard deviation of `rows`, at the middle row
  std::ptrdiff_t first;
  std::size_t count;
  KnownChips known{};  // of these chips or others; used by `reduced` and `mlse`, optional for others
  // (rows) standard deviation of each; empty: `noise`. `inverse` uses `noise` alone.
  std::span<const double> row_noise{};
  SearchEffort* effort = nullptr;  // counted down by `reduced`, which gives ratios of 0 once it is used up

  [[nodiscard]] double noise_of(std::size_t row) const {
    return (row_noise.empty() ? noise : row_noise[row]) / clock.share_at(static_cast<std::ptrdiff_t>(row));
  }
};

// One level (0 or 1) per chip.
using DetectChips = std::function<std::vector<double>(const ChipQuestion&)>;

struct RefineOptions {
  bool exposure_known = false;
  std::size_t highest_degree = 4;  // maximum degree of dark and swing along the frame, selected by Schwarz's criterion
  KnownChips known{};              // chips that need no detection: a preamble
  SearchEffort* effort = nullptr;  // once used up, the best result so far is returned; nullptr: no limit
  bool warped = false;             // the rows may be displaced, by a smooth warp
};

struct RefinedChannel {
  ChannelEstimate channel;
  std::vector<double> chips;  // of the whole frame
  std::ptrdiff_t first = 0;   // index of the first of them
  bool settled = false;       // the last detection changed no chip
  bool even = false;          // all parts of the frame are explained equally well: the clock was not lost
  RowWarp warp{};             // with `warped`: of the picture's rows; channel and chips are those of the even rows
};

// Grows the rows from those of the start to the whole frame, limited at each step by the certainty of the clock. Absent
// if the detected chips do not determine a channel.
std::optional<RefinedChannel> refine_channel(std::span<const double> signal, const ChannelEstimate& start,
                                             const DetectChips& detect, const RefineOptions& options = {});

struct ChannelSearch {
  double rows_per_chip;                 // nominal
  double tolerance = 0.02;              // max relative error of rows_per_chip
  std::optional<double> exposure_rows;  // rows; absent: estimated
  double max_exposure_chips = 7;        // chips, if the exposure is estimated
};

// Channel without a preamble: starts over several phases, rates and exposures on a short part of the frame; the start
// with the smallest residual is refined over the frame. Absent if no start leads to a channel.
std::optional<RefinedChannel> find_channel(std::span<const double> signal, const ChannelSearch& search,
                                           const DetectChips& detect, const RefineOptions& options = {});

}  // namespace ocisac
