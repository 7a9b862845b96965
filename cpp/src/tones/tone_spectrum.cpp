#include "ocisac/tones/tone_spectrum.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <type_traits>
#include <variant>

#include "core/levels.hpp"
#include "core/spectrum.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/rows/tone_search.hpp"
#include "ocisac/tones/find_frequency.hpp"

namespace ocisac {

namespace {

// Calls `use` with a dense view of the selected columns.
template <class Use>
void with_columns(const AnyFramesView& frame, const std::vector<std::uint8_t>& used, Use use) {
  std::visit(
      [&](const auto& view) {
        using Sample = std::remove_const_t<std::remove_pointer_t<decltype(view.data)>>;
        std::vector<Sample> samples;
        for (std::size_t row = 0; row < view.rows; ++row)
          for (std::size_t column = 0; column < view.columns; ++column)
            if (used[column] != 0) samples.push_back(view(0, row, column));
        use(AnyFramesView(as_const(dense_view(samples.data(), 1, view.rows, samples.size() / view.rows))));
      },
      frame);
}

}  // namespace

std::vector<double> amplitude_spectrum(std::span<const double> signal) {
  const std::size_t rows = signal.size();
  require(rows > 0, "signal", "none", "at least one row");
  const double mean = mean_of(signal);
  const std::vector<double> window = hann_window(rows);
  std::vector<double> windowed(4 * rows);
  for (std::size_t n = 0; n < rows; ++n) windowed[n] = (signal[n] - mean) * window[n];
  const auto spectrum = half_spectra(windowed, windowed.size());
  const double scale = 2 / (static_cast<double>(rows) * mean_of(window) * (mean > 0 ? mean : 1));
  std::vector<double> amplitude(spectrum.size());
  std::ranges::transform(spectrum, amplitude.begin(), [&](const auto& line) { return scale * std::abs(line); });
  return amplitude;
}

ToneSpectrum tone_spectrum(const AnyFramesView& frame, const Camera& camera, std::optional<double> frequency,
                           const ToneGainOptions& options) {
  check(frame);
  check(camera);
  if (frequency) require_positive("frequency", *frequency);
  ToneSpectrum result{kNaN, kNaN, kNaN, kNaN, kNaN, kNaN, kNaN, 0, 0, {}, {}};
  FrequencySearch search;
  search.saturation = saturation_level(frame, camera.tone_curve);
  ToneColumns selected;
  if (frequency) {
    result.frequency = *frequency;
    selected = tone_columns(frame, *frequency * camera.row_time, search.saturation);
  } else {
    FoundFrequency found = find_frequency(frame, search);
    result.flags = found.flags;
    if ((found.flags & flag::no_tone) == 0) {
      result.frequency = found.frequency / camera.row_time;
      result.frequency_std = found.frequency_std / camera.row_time;
    }
    selected = std::move(found.columns);
  }
  if (std::ranges::none_of(selected.used, [](auto used) { return used != 0; }))
    std::ranges::fill(selected.used, std::uint8_t{1});
  with_columns(frame, selected.used, [&](const AnyFramesView& columns) {
    result.columns = shape_of(columns).columns;
    const std::vector<double> weights(result.columns, 1 / static_cast<double>(result.columns));
    result.column = weighted_rows(columns, 0, camera.tone_curve, weights);
    if (!std::isfinite(result.frequency)) return;
    ToneGainOptions pooled = options;
    pooled.pooled = true;
    const ToneGain gain = tone_gain(columns, camera, {&result.frequency, 1}, pooled);
    result.gain = gain.gain.front();
    result.gain_std = gain.gain_std.front();
    result.phase = gain.phase.front();
    result.mean = gain.mean.front();
    result.snr = gain.snr.front();
    result.flags |= gain.flags.front();
  });
  result.amplitude = amplitude_spectrum(result.column);
  const double ratio = full_depth_ratio(options.waveform, options.duty);
  for (double& value : result.amplitude) value /= ratio;
  return result;
}

}  // namespace ocisac
