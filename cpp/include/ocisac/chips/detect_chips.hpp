// The detectors behind one interface: from rows and a channel to a log-likelihood ratio for each chip.
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

// In the order of what they cost.
enum class DetectorMethod {
  slicer,     // the middle of each chip against a threshold half way between dark and bright
  wiener,     // the best linear estimate of each chip from all rows, and a threshold
  dfe,        // the same with the chips before it taken as decided and their part in the box taken away
  inverse,    // equalize(), then as the slicer
  reduced,    // search_reduced: the likeliest sequences; up to kLongestReducedExposure chips of exposure
  mlse,       // detect_sequence: all sequences; up to kLongestDetectedExposure
  automatic,  // slicer where it makes at most 1.5 times the errors of the likeliest sequence (or 1e-9), else reduced
};
inline constexpr std::array<std::string_view, 7> kDetectorNames{"slicer",  "wiener", "dfe", "inverse",
                                                                "reduced", "mlse",   "auto"};
DetectorMethod detector_method(std::string_view name);  // throws std::invalid_argument for another

struct DetectedChips {
  // (chips) ln p(rows | bright) − ln p(rows | dark); 0 for a chip that no row tells. Of slicer, inverse, wiener and
  // dfe with the other chips taken as Gaussian noise.
  std::vector<double> llr;
  DetectorMethod method;  // that was used
};

// Throws std::invalid_argument for an exposure beyond what the method takes (linear ones: kLongestReducedExposure),
// and for values that are not finite or out of range.
DetectedChips detect_chips(const ChipQuestion& question, DetectorMethod method = DetectorMethod::automatic);

// What refine_channel and find_channel take: the same as levels, 0 or 1. An exposure beyond the longest gives 0s.
DetectChips level_detector(DetectorMethod method = DetectorMethod::automatic);

// A signal of linear light as rows from 0 (steady dark) to 1 (steady bright), with the chips that they see.
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
  std::ptrdiff_t first = 0;  // number of the first chip that a row sees
  std::size_t count = 0;
  DetectorMethod method{};
};
ColumnChips detect_chips(const AnyFramesView& frames, const Camera& camera, const ChannelEstimate& channel,
                         DetectorMethod method = DetectorMethod::automatic);

}  // namespace ocisac
