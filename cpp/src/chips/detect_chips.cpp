#include "ocisac/chips/detect_chips.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <string>

#include "chips/threshold_detectors.hpp"
#include "core/levels.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/chips/error_rates.hpp"
#include "ocisac/chips/sequence_detector.hpp"
#include "ocisac/core/require.hpp"
#include "rows/exposed_chips.hpp"

namespace ocisac {

namespace {

constexpr double kSlicedExposure = 1.5;  // chips; longer exposures close the slicer's eye
constexpr double kHardlyMore = 1.5;      // times the error rate of the ML sequence

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
std::vector<double> wiener_llr(const ChipEquations& equations) {
  auto llr = estimates(equations, false);
  const auto variances = equations.variances();
  for (std::size_t chip = 0; chip < llr.size(); ++chip) llr[chip] /= variances[chip];
  return llr;
}

std::vector<double> dfe_llr(const ChipEquations& equations) {
  auto llr = estimates(equations, true);
  for (std::size_t chip = 0; chip < llr.size(); ++chip) llr[chip] *= equations.precision(chip);
  return llr;
}

// A question and its equations, which are built once and only if needed.
class Problem {
 public:
  explicit Problem(const ChipQuestion& asked) : question(asked) {}
  const ChipEquations& equations() {
    if (!equations_) equations_.emplace(question, kLongestReducedExposure);
    return *equations_;
  }

  const ChipQuestion& question;

 private:
  std::optional<ChipEquations> equations_;
};

// True if the exposure is short and the slicer's error rate is near that of the ML sequence.
bool is_sliceable(Problem& problem) {
  const ChipQuestion& question = problem.question;
  if (!(question.clock.exposure_rows < kSlicedExposure * question.clock.rows_per_chip)) return false;
  const double errors = slicer_error_rate(question.clock, question.noise);
  return errors < kEqual || errors < kHardlyMore * sequence_error_rate(problem.equations());
}

struct Detector {
  std::string_view name;
  double longest_exposure;               // chips
  std::vector<double> (*llr)(Problem&);  // (chips)
  bool (*suits)(Problem&) = nullptr;     // "auto" selects the first that suits; nullptr: never
};

// All detectors, in order of run time; bindings, command line, tests and chart read their names from here. "auto" does
// not select wiener and dfe: where they are adequate they cost as much as the reduced search, and elsewhere they have
// higher error rates.
constexpr std::array kDetectors{
    // The middle of each chip against the mean of dark and bright.
    Detector{"slicer", kLongestReducedExposure, [](Problem& p) { return slice_chips(p.question); }, is_sliceable},
    // Linear MMSE estimate of each chip from all rows, then a threshold.
    Detector{"wiener", kLongestReducedExposure, [](Problem& p) { return wiener_llr(p.equations()); }},
    // The same with decision feedback: the contribution of earlier decided chips is subtracted.
    Detector{"dfe", kLongestReducedExposure, [](Problem& p) { return dfe_llr(p.equations()); }},
    // equalize(), then as the slicer.
    Detector{"inverse", kLongestReducedExposure, [](Problem& p) { return invert_and_slice_chips(p.question); }},
    // The most likely sequences.
    Detector{"reduced", kLongestReducedExposure,
             [](Problem& p) { return search_reduced(p.equations(), {.effort = p.question.effort}); },
             [](Problem&) { return true; }},
    // All sequences.
    Detector{"mlse", kLongestDetectedExposure, [](Problem& p) { return detect_sequence(p.question); }},
};
constexpr auto kNames = [] {
  std::array<std::string_view, kDetectors.size() + 1> names;
  std::ranges::transform(kDetectors, names.begin(), &Detector::name);
  names.back() = "auto";
  return names;
}();

// Returns nullptr for "auto".
const Detector* find_detector(std::string_view name) {
  const auto at = static_cast<std::size_t>(std::ranges::find(kNames, name) - kNames.begin());
  if (at < kDetectors.size()) return &kDetectors[at];
  if (at < kNames.size()) return nullptr;
  std::string allowed(kNames.front());
  for (std::size_t k = 1; k < kDetectors.size(); ++k) allowed.append(", ").append(kNames[k]);
  refuse("method", std::string(name), allowed.append(" or ").append(kNames.back()));
}

double longest_exposure(const Detector* detector) {
  return detector ? detector->longest_exposure : kLongestReducedExposure;
}

DetectedChips detect(const ChipQuestion& question, const Detector* detector) {
  check(question, longest_exposure(detector));
  Problem problem(question);
  if (!detector)
    detector = std::ranges::find_if(kDetectors, [&](const Detector& d) { return d.suits && d.suits(problem); });
  return {detector->llr(problem), detector->name};
}

}  // namespace

std::span<const std::string_view> detector_names() { return kNames; }

DetectedChips detect_chips(const ChipQuestion& question, std::string_view method) {
  return detect(question, find_detector(method));
}

DetectChips level_detector(std::string_view method) {
  return [detector = find_detector(method)](const ChipQuestion& question) {
    if (!(question.clock.exposure_rows <= longest_exposure(detector) * question.clock.rows_per_chip))
      return std::vector<double>(question.count);
    auto levels = detect(question, detector).llr;
    for (double& level : levels) level = level > 0 ? 1 : 0;
    return levels;
  };
}

ChipRows::ChipRows(std::span<const double> signal, const ChannelEstimate& channel)
    : rows_(signal.size()), clock_(with_min_exposure(channel.clock)) {
  const bool even = channel.swing.size() < 2;
  if (!even) row_noise_.resize(rows_.size());
  for (std::size_t n = 0; n < rows_.size(); ++n) {
    const auto row = static_cast<double>(n);
    const double swing = channel.swing_at(row, rows_.size());
    if (!(swing > 0))
      refuse("channel", "a swing of " + shortest_text(swing) + " in row " + std::to_string(n), "above 0");
    rows_[n] = (signal[n] - channel.dark_at(row, rows_.size())) / swing;
    if (!even) row_noise_[n] = std::max(channel.noise / swing, kMinDetectorNoise);
  }
  const double middle = 0.5 * (static_cast<double>(rows_.size()) - 1);
  noise_ = std::max(channel.noise / channel.swing_at(middle, rows_.size()), kMinDetectorNoise);
}

ChipQuestion ChipRows::question() const {
  const ChipGrid chips = affecting_chips(clock_, rows_.size());
  return {rows_, clock_, noise_, chips.first, chips.count, {}, row_noise_};
}

ColumnChips detect_chips(const AnyFramesView& frames, const Camera& camera, const ChannelEstimate& channel,
                         std::string_view method) {
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
