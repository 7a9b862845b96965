// Common interface of the detectors: log-likelihood ratios of the chips from rows and a channel.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/chips/reduced_search.hpp"
#include "ocisac/chips/refine_channel.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// In order of run time.
enum class DetectorMethod {
  slicer,     // the middle of each chip against the mean of dark and bright
  wiener,     // linear MMSE estimate of each chip from all rows, then a threshold
  dfe,        // the same with decision feedback: the contribution of earlier decided chips is subtracted
  inverse,    // equalize(), then as the slicer
  reduced,    // search_reduced: the most likely sequences; exposures up to kLongestReducedExposure chips
  mlse,       // detect_sequence: all sequences; exposures up to kLongestDetectedExposure chips
  automatic,  // slicer if its error rate is at most 1.5 times that of the ML sequence (or 1e-9), else reduced
};
inline constexpr std::array<std::string_view, 7> kDetectorNames{"slicer",  "wiener", "dfe", "inverse",
                                                                "reduced", "mlse",   "auto"};
DetectorMethod detector_method(std::string_view name);  // throws std::invalid_argument for another

struct DetectedChips {
  // (chips) ln p(rows | bright) − ln p(rows | dark); 0 for a chip that no row covers. Slicer, inverse, wiener and dfe
  // model the other chips as Gaussian noise.
  std::vector<double> llr;
  DetectorMethod method;  // the method used
};

// Throws std::invalid_argument for an exposure beyond the range of the method (linear ones: kLongestReducedExposure),
// and for values that are not finite or out of range.
DetectedChips detect_chips(const ChipQuestion& question, DetectorMethod method = DetectorMethod::automatic);

// Hard decisions 0 or 1 for refine_channel and find_channel; all 0 for an exposure beyond the range.
DetectChips level_detector(DetectorMethod method = DetectorMethod::automatic);

// A signal of linear light scaled to rows from 0 (steady dark) to 1 (steady bright), with the chips that affect them.
class ChipRows {
 public:
  ChipRows(std::span<const double> signal, const ChannelEstimate& channel);
  [[nodiscard]] ChipQuestion question() const { return {rows_, clock_, noise_, first_, count_}; }

 private:
  std::vector<double> rows_;
  ChipClock clock_;
  double noise_;
  std::ptrdiff_t first_;
  std::size_t count_;
};

// Chips of columns that share a channel.
struct ColumnChips {
  std::vector<double> llr;   // frames × chips × columns
  std::ptrdiff_t first = 0;  // index of the first chip that affects a row
  std::size_t count = 0;
  DetectorMethod method{};
};
ColumnChips detect_chips(const AnyFramesView& frames, const Camera& camera, const ChannelEstimate& channel,
                         DetectorMethod method = DetectorMethod::automatic);

}  // namespace ocisac
