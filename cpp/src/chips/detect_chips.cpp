#include "ocisac/chips/detect_chips.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "chips/threshold_detectors.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/chips/error_rates.hpp"
#include "ocisac/chips/sequence_detector.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr double kMinNoise = 1e-4;       // relative to the swing, for a detector
constexpr double kSlicedExposure = 1.5;  // chips; longer exposures close the slicer's eye
constexpr double kHardlyMore = 1.5;      // times the error rate of the ML sequence
constexpr double kHardlyAny = 1e-9;

// Estimates x = M⁻¹z by forward substitution; optionally with decisions fed back in their place.
std::vector<double> estimates(const ChipEquations& equations, bool feed_decisions_back) {
  std::vector<double> values(equations.count()), fed(equations.count());
  for (std::size_t chip = 0; chip < values.size(); ++chip) {
    const double* shares = equations.feedback(chip);
    double value = equations.target(chip);
    for (std::size_t back = 1; back <= std::min(equations.band(), chip); ++back)
      value -= shares[back] * fed[chip - back];
    values[chip] = value;
    fed[chip] = !feed_decisions_back ? value : value > 0 ? 0.5 : -0.5;
  }
  return values;
}

// Estimate x of a chip with remaining variance e (prior: ¼): given the chip it is Gaussian about ±(1 − 4e)/2 with
// variance e·(1 − 4e), so that the log-likelihood ratio is x/e.
std::vector<double> linear_ratios(const ChipEquations& equations) {
  auto ratios = estimates(equations, false);
  const auto variances = equations.variances();
  for (std::size_t chip = 0; chip < ratios.size(); ++chip) ratios[chip] /= variances[chip];
  return ratios;
}

std::vector<double> feedback_ratios(const ChipEquations& equations) {
  auto ratios = estimates(equations, true);
  for (std::size_t chip = 0; chip < ratios.size(); ++chip) ratios[chip] *= equations.precision(chip);
  return ratios;
}

// Selects the slicer for exposures short enough. Wiener and decision feedback cost as much as the reduced search where
// they are adequate, and have higher error rates elsewhere.
DetectedChips detect_automatically(const ChipQuestion& question) {
  const bool sliceable = question.clock.exposure_rows < kSlicedExposure * question.clock.rows_per_chip;
  const double slicer = sliceable ? slicer_error_rate(question.clock, question.noise) : 0.5;
  if (slicer < kHardlyAny) return {slice_chips(question), DetectorMethod::slicer};
  const ChipEquations equations(question, kLongestReducedExposure);
  if (sliceable && slicer < kHardlyMore * sequence_error_rate(equations))
    return {slice_chips(question), DetectorMethod::slicer};
  return {search_reduced(equations), DetectorMethod::reduced};
}

}  // namespace

DetectorMethod detector_method(std::string_view name) {
  const auto found = std::ranges::find(kDetectorNames, name);
  if (found == kDetectorNames.end())
    refuse("method", std::string(name), "slicer, wiener, dfe, inverse, reduced, mlse or auto");
  return static_cast<DetectorMethod>(found - kDetectorNames.begin());
}

DetectedChips detect_chips(const ChipQuestion& question, DetectorMethod method) {
  if (method == DetectorMethod::mlse) return {detect_sequence(question).llr, method};
  check(question, kLongestReducedExposure);
  if (method == DetectorMethod::automatic) return detect_automatically(question);
  if (method == DetectorMethod::slicer) return {slice_chips(question), method};
  if (method == DetectorMethod::inverse) return {invert_and_slice_chips(question), method};
  const ChipEquations equations(question, kLongestReducedExposure);
  switch (method) {
    case DetectorMethod::wiener: return {linear_ratios(equations), method};
    case DetectorMethod::dfe: return {feedback_ratios(equations), method};
    default: return {search_reduced(equations), method};
  }
}

DetectChips level_detector(DetectorMethod method) {
  const double longest = method == DetectorMethod::mlse ? kLongestDetectedExposure : kLongestReducedExposure;
  return [=](const ChipQuestion& question) {
    if (!(question.clock.exposure_rows <= longest * question.clock.rows_per_chip))
      return std::vector<double>(question.count);
    auto levels = detect_chips(question, method).llr;
    for (double& level : levels) level = level > 0 ? 1 : 0;
    return levels;
  };
}

ChipRows::ChipRows(std::span<const double> signal, const ChannelEstimate& channel)
    : rows_(signal.size()), clock_(channel.clock) {
  clock_.exposure_rows = std::max(clock_.exposure_rows, kShortestExposure);
  for (std::size_t n = 0; n < rows_.size(); ++n) {
    const auto row = static_cast<double>(n);
    const double swing = channel.swing_at(row, rows_.size());
    require(swing > 0, "channel", "a swing of " + shortest_text(swing) + " in row " + std::to_string(n), "above 0");
    rows_[n] = (signal[n] - channel.dark_at(row, rows_.size())) / swing;
  }
  const auto chip_at = [&](double row) {
    return static_cast<std::ptrdiff_t>(std::floor((row - clock_.phase) / clock_.rows_per_chip));
  };
  const double last_row = static_cast<double>(rows_.size()) - 1, half = 0.5 * clock_.exposure_rows;
  noise_ = std::max(channel.noise / channel.swing_at(0.5 * last_row, rows_.size()), kMinNoise);
  first_ = chip_at(-half);
  count_ = static_cast<std::size_t>(chip_at(last_row + half) - first_ + 1);
}

ColumnChips detect_chips(const AnyFramesView& frames, const Camera& camera, const ChannelEstimate& channel,
                         DetectorMethod method) {
  check(camera);
  check(frames);
  require_positive("rows_per_chip", channel.clock.rows_per_chip);
  require_finite("phase", channel.clock.phase);
  require_not_negative("exposure_rows", channel.clock.exposure_rows);
  require(!channel.dark.empty() && !channel.swing.empty(), "channel", "no levels", "coefficients of dark and swing");
  const Shape shape = shape_of(frames);
  ColumnChips result;
  for (std::size_t frame = 0; frame < shape.frames; ++frame)
    for (std::size_t column = 0; column < shape.columns; ++column) {
      const ChipRows rows(column_signals(frames, frame, column, 1, camera.tone_curve), channel);
      const ChipQuestion question = rows.question();
      const auto found = detect_chips(question, method);
      result.first = question.first;
      result.count = question.count;
      result.method = found.method;
      result.llr.resize(shape.frames * question.count * shape.columns);
      for (std::size_t k = 0; k < question.count; ++k)
        result.llr[(frame * question.count + k) * shape.columns + column] = found.llr[k];
    }
  return result;
}

}  // namespace ocisac
