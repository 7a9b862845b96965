// Common interface of the detectors: log-likelihood ratios of the chips from rows and a channel.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/chips/reduced_search.hpp"
#include "ocisac/chips/refine_channel.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Names in the list of detect_chips.cpp, followed by "auto": the first of the list that suits the question.
std::span<const std::string_view> detector_names();

struct DetectedChips {
  // (chips) ln p(rows | bright) − ln p(rows | dark); 0 for a chip that no row covers. Slicer, inverse, wiener and dfe
  // model the other chips as Gaussian noise.
  std::vector<double> llr;
  std::string_view method;  // the method used
};

// Throws std::invalid_argument for a name that is not listed, for an exposure beyond the detector's longest, and for
// values that are not finite or out of range.
DetectedChips detect_chips(const ChipQuestion& question, std::string_view method = "auto");

// Hard decisions 0 or 1 for refine_channel and find_channel; all 0 for an exposure beyond the range.
DetectChips level_detector(std::string_view method = "auto");

// A signal of linear light scaled to rows from 0 (steady dark) to 1 (steady bright), with the chips that affect them.
class ChipRows {
 public:
  ChipRows(std::span<const double> signal, const ChannelEstimate& channel);
  [[nodiscard]] ChipQuestion question() const;

 private:
  std::vector<double> rows_;
  std::vector<double> row_noise_;  // empty where the swing is the same in all rows
  ChipClock clock_;
  double noise_;
};

// Chips of columns that share a channel.
struct ColumnChips {
  std::vector<double> llr;   // frames × chips × columns
  std::ptrdiff_t first = 0;  // index of the first chip that affects a row
  std::size_t count = 0;
  std::string_view method;
};
ColumnChips detect_chips(const AnyFramesView& frames, const Camera& camera, const ChannelEstimate& channel,
                         std::string_view method = "auto");

}  // namespace ocisac
