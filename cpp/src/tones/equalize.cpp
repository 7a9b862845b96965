#include "ocisac/tones/equalize.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <string>

#include "columns/light_and_noise.hpp"
#include "core/check_interrupt.hpp"
#include "core/linear_algebra.hpp"
#include "core/spectrum.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"

namespace ocisac {

namespace {

using Matrix = Eigen::MatrixXd;
using Eigen::Index;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr std::size_t kMinAnalysedRows = 16;  // fewer rows do not determine a spectrum: wiener is the inverse

void check_max_boost(double max_boost) {
  require(max_boost >= 1 && max_boost <= 1e6, "max_boost", max_boost, "1 to 1e6");
}

// ---- The ends of the column ----------------------------------------------------------------------------------------
// Rows beyond the ends are predicted from the nearest rows. The prediction is the conditional mean under a model of
// white-noise light after the exposure, plus a smooth component of 100 times its variance, and row noise of 1/1000 of
// its variance.
constexpr double smooth_share = 100;
constexpr double noise_share = 0.001;
constexpr double longest_reach = 1024;  // rows; bounds the run time for very long exposures

double covariance(double rows_apart, double exposure_rows) {
  const double reach = rows_apart / (2 * exposure_rows + 16);
  return std::max(0.0, 1 - rows_apart / std::max(exposure_rows, 1.0)) + smooth_share / (1 + reach * reach);
}

// (predicted rows × used rows); row 0 predicts the first row beyond the end, column 0 weights the last row before it.
// Predictions decay to zero, so that both ends join in the period of the DFT.
Matrix continuation(std::size_t rows, double exposure_rows) {
  const auto reach = [&](double beyond) {
    return static_cast<Index>(
        std::min({std::ceil(4 * exposure_rows) + beyond, longest_reach, static_cast<double>(rows)}));
  };
  const Index used = reach(16), predicted = reach(32);
  const auto of_distance = [&](Index distance) { return covariance(static_cast<double>(distance), exposure_rows); };
  const Matrix seen = Matrix::NullaryExpr(used, used, [&](Index i, Index j) {
    return of_distance(std::abs(i - j)) + (i == j ? noise_share * std::max(exposure_rows, 1.0) : 0);
  });
  const Matrix ahead = Matrix::NullaryExpr(used, predicted, [&](Index i, Index j) { return of_distance(i + j + 1); });
  Matrix weights = solve_positive_definite(seen, ahead).transpose();
  for (Index i = 0; i < predicted; ++i)
    weights.row(i) *=
        0.5 + 0.5 * std::cos(std::numbers::pi * static_cast<double>(i + 1) / static_cast<double>(predicted + 1));
  return weights;
}

// ---- One column ----------------------------------------------------------------------------------------------------

struct Line {
  double mean = 0, slope = 0, middle = 0;  // value at row n: mean + slope·(n − middle)
  [[nodiscard]] double at(double row) const { return mean + slope * (row - middle); }
};

Line least_squares_line(std::span<const double> signal) {
  const double count = static_cast<double>(signal.size());
  Line line{std::accumulate(signal.begin(), signal.end(), 0.0) / count, 0, (count - 1) / 2};
  double products = 0, squares = 0;
  for (std::size_t n = 0; n < signal.size(); ++n) {
    const double from_middle = static_cast<double>(n) - line.middle;
    products += from_middle * (signal[n] - line.mean);
    squares += from_middle * from_middle;
  }
  if (squares > 0) line.slope = products / squares;
  return line;
}

// A power of two of the size of the signal, with which squares neither overflow nor vanish.
double unit_of(std::span<const double> signal) {
  double largest = 0;
  for (const double value : signal) largest = std::max(largest, std::abs(value));
  return std::isnormal(largest) ? std::exp2(std::ilogb(largest)) : 1.0;
}

// Response of the exposure at k/length cycles per row, k = 0 … length/2: |H| with its sign, and its delay.
struct Response {
  Response(std::size_t length_of_dft, double exposure_rows)
      : length(length_of_dft), sinc_at(length / 2 + 1), advance(sinc_at.size()) {
    for (std::size_t k = 0; k < sinc_at.size(); ++k) {
      const double turns = static_cast<double>(k) * exposure_rows / static_cast<double>(length);
      sinc_at[k] = sinc(turns);
      advance[k] = std::polar(1.0, std::numbers::pi * std::fmod(turns, 2.0));
    }
  }
  [[nodiscard]] double frequency(double bin) const { return bin / static_cast<double>(length); }

  std::size_t length;
  std::vector<double> sinc_at;
  std::vector<std::complex<double>> advance;
};

// ---- All columns ---------------------------------------------------------------------------------------------------

// A gain per bin of the DFT as it is applied, with the delay corrected; the fraction of the amplitude that it restores.
struct Filter {
  std::vector<std::complex<double>> gain;
  std::vector<double> restored;
  double noise_gain = 0;
};

class Equalizer {
 public:
  Equalizer(std::size_t rows, double exposure_rows, const EqualizerSettings& settings)
      : rows_(rows),
        exposure_rows_(exposure_rows),
        settings_(settings),
        continuation_(continuation(rows, exposure_rows)),
        response_(optimal_dft_length(rows + 2 * static_cast<std::size_t>(continuation_.rows())), exposure_rows),
        inverse_(filter_of(inverse_gain())),
        restored_(response_.sinc_at.size(), 0.0) {
    if (settings.method == EqualizerMethod::wiener && rows >= kMinAnalysedRows)
      analysis_.emplace(rows, exposure_rows, response_.length);
  }

  // Equalises `signals` (count × rows) in place; `noise` (count, or empty: estimated).
  void run(std::span<double> signals, std::span<const double> noise, EqualizerReport& report) {
    const std::size_t count = signals.size() / rows_;
    std::vector<Line> lines(count);
    std::vector<double> units(count);
    for (std::size_t c = 0; c < count; ++c) {
      const auto signal = signals.subspan(c * rows_, rows_);
      lines[c] = least_squares_line(signal);
      for (std::size_t n = 0; n < rows_; ++n) signal[n] -= lines[c].at(static_cast<double>(n));
      units[c] = unit_of(signal);
      for (double& value : signal) value /= units[c];
    }
    std::vector<ColumnAnalysis::Result> analysed(count);
    for (std::size_t c = 0; c < count && analysis_; ++c) {
      check_interrupt();
      const auto known = noise.empty() ? std::nullopt : std::optional(std::pow(noise[c] / units[c], 2));
      if (known != 0.0) analysed[c] = analysis_->take_off_course(signals.subspan(c * rows_, rows_), known);
    }
    auto spectra = half_spectra(extended(signals, count), response_.length);
    const std::size_t bins = response_.sinc_at.size();
    for (std::size_t c = 0; c < count; ++c) {
      report.noise.push_back(units[c] * std::sqrt(analysed[c].rest.noise));
      const auto spectrum = std::span(spectra).subspan(c * bins, bins);
      const bool is_inverse = analysed[c].course.empty();
      const Filter own = is_inverse ? Filter{} : filter_of(bounded(analysis_->gain(analysed[c].rest)));
      report.noise_gain.push_back(apply(is_inverse ? inverse_ : own, spectrum));
    }
    const auto equalised = signals_of_half_spectra(spectra, response_.length);
    for (std::size_t c = 0; c < count; ++c)
      for (std::size_t n = 0; n < rows_; ++n)
        signals[c * rows_ + n] = units[c] * (equalised[c * response_.length + n] +
                                             (analysed[c].course.empty() ? 0 : analysed[c].course[n])) +
                                 lines[c].at(static_cast<double>(n) + exposure_rows_ / 2);
  }

  // Bands (cycles per row) whose restored amplitude, averaged over the columns so far, is below 1/2.
  [[nodiscard]] std::vector<FrequencyBand> bands_lost(double columns) const {
    std::vector<FrequencyBand> bands;
    const auto excess = [&](std::size_t k) { return restored_[k] / columns - 0.5; };
    bool inside = false;
    for (std::size_t k = 0; k < restored_.size(); ++k) {
      const bool lost = excess(k) < 0;
      if (lost == inside) continue;
      const double crossing = k == 0 ? 0 : static_cast<double>(k) - excess(k) / (excess(k) - excess(k - 1));
      if (lost)
        bands.push_back({response_.frequency(crossing), infinity});
      else
        bands.back().high = response_.frequency(crossing);
      inside = lost;
    }
    if (!inside) bands.push_back({0.5, infinity});
    return bands;
  }

 private:
  // (count × length): each signal, its continuation after the end, zeros, its continuation before the start.
  [[nodiscard]] std::vector<double> extended(std::span<const double> signals, std::size_t count) const {
    const Index used = continuation_.cols(), predicted = continuation_.rows();
    const auto columns = static_cast<Index>(count), rows = static_cast<Index>(rows_);
    const Eigen::Map<const Matrix> inside(signals.data(), rows, columns);
    std::vector<double> result(count * response_.length, 0.0);
    Eigen::Map<Matrix> all(result.data(), static_cast<Index>(response_.length), columns);
    all.topRows(rows) = inside;
    all.middleRows(rows, predicted) = product(continuation_, inside.bottomRows(used).colwise().reverse());
    all.bottomRows(predicted) = product(continuation_, inside.topRows(used)).colwise().reverse();
    return result;
  }

  // G = H/max(|H|², 1/max_boost²) with H without its delay.
  [[nodiscard]] std::vector<std::complex<double>> inverse_gain() const {
    const double floor = 1 / (settings_.max_boost * settings_.max_boost);
    std::vector<std::complex<double>> gain;
    for (const double h : response_.sinc_at) gain.emplace_back(h / std::max(h * h, floor));
    return gain;
  }

  [[nodiscard]] std::vector<std::complex<double>> bounded(std::vector<std::complex<double>> gain) const {
    for (auto& value : gain)
      if (const double size = std::abs(value); size > settings_.max_boost) value *= settings_.max_boost / size;
    return gain;
  }

  [[nodiscard]] Filter filter_of(std::vector<std::complex<double>> gain) const {
    Filter filter{std::move(gain), {}, 0};
    double power = 0;
    for (std::size_t k = 0; k < filter.gain.size(); ++k) {
      power += std::norm(filter.gain[k]);
      filter.restored.push_back(filter.gain[k].real() * response_.sinc_at[k]);
      filter.gain[k] *= response_.advance[k];
    }
    filter.noise_gain = std::sqrt(power / static_cast<double>(filter.gain.size()));
    return filter;
  }

  // Returns the noise gain.
  double apply(const Filter& filter, std::span<std::complex<double>> spectrum) {
    for (std::size_t k = 0; k < spectrum.size(); ++k) {
      spectrum[k] *= filter.gain[k];
      restored_[k] += filter.restored[k];
    }
    return filter.noise_gain;
  }

  std::size_t rows_;
  double exposure_rows_;
  EqualizerSettings settings_;
  Matrix continuation_;
  Response response_;
  Filter inverse_;
  std::optional<ColumnAnalysis> analysis_;  // for wiener
  std::vector<double> restored_;            // sum over columns of the restored fraction of the amplitude
};

void write(const FramesView<double>& out, std::size_t frame, std::size_t first, std::span<const double> signals) {
  const std::size_t count = signals.size() / out.rows;
  for (std::size_t row = 0; row < out.rows; ++row)
    for (std::size_t c = 0; c < count; ++c) out(frame, row, first + c) = signals[c * out.rows + row];
}

// Calls work(frame, first column, signals) for blocks of columns, and writes the resulting `signals`.
template <class Work>
void for_each_block(const AnyFramesView& frames, const Camera& camera, std::size_t block, const FramesView<double>& out,
                    Work work) {
  for (std::size_t frame = 0; frame < out.frames; ++frame)
    for (std::size_t first = 0; first < out.columns; first += block) {
      check_interrupt();
      const std::size_t count = std::min(block, out.columns - first);
      auto signals = column_signals(frames, frame, first, count, camera.tone_curve);
      work(frame, first, std::span(signals));
      write(out, frame, first, signals);
    }
}

// No exposure: identity. An exposure of the whole frame or more: only the mean remains.
EqualizerReport without_dft(const AnyFramesView& frames, const Camera& camera, const FramesView<double>& out) {
  const bool identity = *camera.exposure == 0;
  const std::size_t columns = out.frames * out.columns;
  for_each_block(frames, camera, 64, out, [&](std::size_t, std::size_t, std::span<double> signals) {
    if (identity) return;
    for (std::size_t start = 0; start < signals.size(); start += out.rows) {
      const auto signal = signals.subspan(start, out.rows);
      std::ranges::fill(signal, least_squares_line(signal).mean);
    }
  });
  EqualizerReport report;
  report.frequencies_lost = {{identity ? 0.5 / camera.row_time : 0, infinity}};
  report.noise_gain.assign(columns, identity ? 1 : 1 / std::sqrt(static_cast<double>(out.rows)));
  report.noise.assign(columns, 0);
  return report;
}

void check_settings(const EqualizerSettings& settings, std::size_t columns) {
  check_max_boost(settings.max_boost);
  for (double value : settings.noise) require_not_negative("noise", value);
  const std::size_t count = settings.noise.size();
  require(count <= 1 || count == columns, "noise", std::to_string(count) + " values", "none, one, or one a column");
}

// Maximum of |sinc| between the whole numbers k and k + 1 (k > 0): πx·cos(πx) = sin(πx).
double lobe_peak(double k) {
  double low = k, high = k + 0.5;
  for (int step = 0; step < 60; ++step) {
    const double middle = (low + high) / 2;
    const double angle = std::numbers::pi * (middle - k);
    (std::numbers::pi * middle * std::cos(angle) > std::sin(angle) ? low : high) = middle;
  }
  return low;
}

// Bisection for |sinc(x)| = level between `above` (higher there) and `below` (lower there).
double crossing(double above, double below, double level) {
  for (int step = 0; step < 60; ++step) {
    const double middle = (above + below) / 2;
    (std::abs(sinc(middle)) >= level ? above : below) = middle;
  }
  return below;
}

}  // namespace

std::vector<FrequencyBand> lost_frequencies(const Camera& camera, double max_boost) {
  check(camera);
  check_max_boost(max_boost);
  const double exposure = known_exposure(camera, "equalisation");
  const double highest = 0.5 / camera.row_time;
  const double level = 1 / (std::numbers::sqrt2 * max_boost);
  std::vector<FrequencyBand> bands;
  double low = exposure > 0 ? crossing(0, 1, level) / exposure : infinity;
  for (double k = 1; low < highest; ++k) {
    const double peak = lobe_peak(k);
    if (std::abs(sinc(peak)) < level) break;  // also true in all later lobes
    const double high = crossing(peak, k, level) / exposure;
    if (high >= highest) break;
    bands.push_back({low, high});
    low = crossing(peak, k + 1, level) / exposure;
  }
  bands.push_back({std::min(low, highest), infinity});
  return bands;
}

EqualizerReport equalize(const AnyFramesView& frames, const Camera& camera, const EqualizerSettings& settings,
                         const FramesView<double>& out) {
  check(camera);
  check(frames);
  const Shape shape = shape_of(frames);
  const double exposure_rows = known_exposure(camera, "equalisation") / camera.row_time;
  const std::size_t columns = shape.frames * shape.columns;
  check_settings(settings, columns);
  require(out.frames == shape.frames && out.rows == shape.rows && out.columns == shape.columns, "out", "another shape",
          "the shape of columns");
  if (exposure_rows == 0 || exposure_rows >= static_cast<double>(shape.rows)) return without_dft(frames, camera, out);

  Equalizer equalizer(shape.rows, exposure_rows, settings);
  EqualizerReport report;
  const std::size_t block = std::clamp<std::size_t>(65536 / shape.rows, 4, 64);
  for_each_block(frames, camera, block, out, [&](std::size_t frame, std::size_t first, std::span<double> signals) {
    const std::size_t count = signals.size() / shape.rows;
    const std::vector<double> noise = settings.noise.empty() ? std::vector<double>{}
                                      : settings.noise.size() == 1
                                          ? std::vector<double>(count, settings.noise[0])
                                          : std::vector<double>(&settings.noise[frame * shape.columns + first],
                                                                &settings.noise[frame * shape.columns + first] + count);
    equalizer.run(signals, noise, report);
  });
  if (settings.method == EqualizerMethod::inverse) {
    report.frequencies_lost = lost_frequencies(camera, settings.max_boost);
  } else {
    report.frequencies_lost = equalizer.bands_lost(static_cast<double>(columns));
    for (auto& band : report.frequencies_lost) band = {band.low / camera.row_time, band.high / camera.row_time};
  }
  return report;
}

}  // namespace ocisac
