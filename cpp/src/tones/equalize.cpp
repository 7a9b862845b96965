#include "ocisac/tones/equalize.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <tuple>
#include <type_traits>

#include "columns/column_dft.hpp"
#include "columns/continuation.hpp"
#include "columns/equalizer_kernels.hpp"
#include "columns/light_and_noise.hpp"
#include "core/aligned_memory.hpp"
#include "core/check_interrupt.hpp"
#include "core/parallel.hpp"
#include "core/recently_used.hpp"
#include "core/spectrum.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kMinAnalysedRows = 16;  // fewer rows do not determine a spectrum: wiener is the inverse

void check_max_boost(double max_boost) {
  require(max_boost >= 1 && max_boost <= 1e6, "max_boost", max_boost, "1 to 1e6");
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

// A gain per bin of the DFT as it is applied, with the delay corrected; the fraction of the amplitude that it restores.
struct Filter {
  std::vector<std::complex<double>> gain;
  std::vector<double> restored;
  double noise_gain = 0;
};

Filter filter_of(std::vector<std::complex<double>> gain, const Response& response) {
  Filter filter{std::move(gain), {}, 0};
  double power = 0;
  for (std::size_t k = 0; k < filter.gain.size(); ++k) {
    power += std::norm(filter.gain[k]);
    filter.restored.push_back(filter.gain[k].real() * response.sinc_at[k]);
    filter.gain[k] *= response.advance[k];
  }
  filter.noise_gain = std::sqrt(power / static_cast<double>(filter.gain.size()));
  return filter;
}

// G = H/max(|H|², 1/max_boost²) with H without its delay.
Filter inverse_filter(const Response& response, double max_boost) {
  const double floor = 1 / (max_boost * max_boost);
  std::vector<std::complex<double>> gain;
  for (const double h : response.sinc_at) gain.emplace_back(h / std::max(h * h, floor));
  return filter_of(std::move(gain), response);
}

// (length) Both halves of a real filter for a DFT that is not scaled.
std::vector<std::complex<double>> both_halves(const Filter& filter, std::size_t length) {
  std::vector<std::complex<double>> all(length);
  const double scale = 1 / static_cast<double>(length);
  for (std::size_t k = 0; k < filter.gain.size(); ++k) {
    const bool real = k == 0 || 2 * k == length;
    all[k] = scale * (real ? filter.gain[k].real() : filter.gain[k]);
    if (!real) all[length - k] = std::conj(all[k]);
  }
  return all;
}

// What does not depend on the columns.
struct Plan {
  // The factors of the continuation, the DFT and the inverse filter in its order, in the precision of the columns.
  template <class T>
  struct Tables {
    std::vector<T> terms, smooth;
    ColumnDft<T> dft;
    std::vector<T> gain;  // (length × 2) real and imaginary part
  };

  Plan(std::size_t row_count, double exposure, double max_boost, EqualizerMethod method)
      : rows(row_count),
        exposure_rows(exposure),
        ends(continuation(rows, exposure_rows)),
        response(optimal_dft_length(rows + 2 * ends.predicted), exposure_rows),
        inverse(inverse_filter(response, max_boost)),
        in_float(tables<float>()),
        in_double(tables<double>()) {
    if (method == EqualizerMethod::wiener && rows >= kMinAnalysedRows)
      analysis.emplace(rows, exposure_rows, response.length);
  }

  template <class T>
  [[nodiscard]] const Tables<T>& in() const {
    if constexpr (std::is_same_v<T, float>)
      return in_float;
    else
      return in_double;
  }

  std::size_t rows;
  double exposure_rows;
  Continuation ends;
  Response response;
  Filter inverse;
  std::optional<ColumnAnalysis> analysis;  // for wiener
  Tables<float> in_float;
  Tables<double> in_double;

 private:
  template <class T>
  [[nodiscard]] Tables<T> tables() const {
    const auto of = [](const Continuation::Matrix& matrix) {
      std::vector<T> values(static_cast<std::size_t>(matrix.size()));
      std::transform(matrix.data(), matrix.data() + matrix.size(), values.begin(),
                     [](double value) { return static_cast<T>(value); });
      return values;
    };
    Tables<T> result{of(ends.terms), of(ends.smooth), ColumnDft<T>(response.length), {}};
    const auto gain = both_halves(inverse, response.length);
    for (const std::size_t k : result.dft.order()) {
      result.gain.push_back(static_cast<T>(gain[k].real()));
      result.gain.push_back(static_cast<T>(gain[k].imag()));
    }
    return result;
  }
};

using PlanKey = std::tuple<std::size_t, double, double, EqualizerMethod>;

std::shared_ptr<const Plan> plan_of(const PlanKey& key) {
  static RecentlyUsed<PlanKey, Plan, 4> kept;  // frames of one camera need the same plan
  return kept.get(
      key, [&] { return std::apply([](const auto&... of) { return std::make_shared<const Plan>(of...); }, key); });
}

// ---- Blocks of columns ---------------------------------------------------------------------------------------------

template <class T>
constexpr std::size_t kWidth = 2 * kernels::kColumnPairs<T>;  // columns; the block fits the second-level cache

// Linear light of columns first … first + count in memory order: (rows × width), 0 in columns beyond `count`.
template <class T>
void light_rows(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
                const ToneCurve& curve, std::size_t width, T* block) {
  if (curve.kind != ToneCurve::Kind::linear) {
    const auto signals = column_signals(frames, frame, first, count, curve);
    const std::size_t rows = signals.size() / count;
    for (std::size_t row = 0; row < rows; ++row)
      for (std::size_t c = 0; c < width; ++c)
        block[row * width + c] = c < count ? static_cast<T>(signals[c * rows + row]) : T{0};
    return;
  }
  const T dark = static_cast<T>(curve.dark_level);
  std::visit(
      [&]<class S>(const FramesView<const S>& view) {
        for (std::size_t row = 0; row < view.rows; ++row) {
          const S* const samples = view.at(frame, row, first);
          T* const to = block + row * width;
          if (view.column_stride == 1)
            for (std::size_t c = 0; c < count; ++c) to[c] = static_cast<T>(samples[c]) - dark;
          else
            for (std::size_t c = 0; c < count; ++c) to[c] = static_cast<T>(view(frame, row, first + c)) - dark;
          std::fill(to + count, to + width, T{0});
        }
      },
      frames);
}

// Refuses light of which sums over rows, boosted, are no numbers in T.
template <class T>
void check_light(double largest) {
  constexpr double kMost = 1e-6 * static_cast<double>(std::numeric_limits<T>::max());
  require(std::abs(largest) <= kMost, "columns", "light that is too large",
          "up to 1e-6 of the largest number of out's type");
}

// Memory of a thread, reused from call to call.
template <class T>
struct Memory {
  AlignedMemory<T> block;                                // (length × width)
  std::vector<T> terms;                                  // (terms × width)
  std::vector<double> mean, slope, reach, units, scale;  // (width)
  std::vector<double> less_mean, less_slope;             // (width) in units, negative
  std::vector<double> column;                            // (rows)
};

template <class T>
void store(const T* block, std::size_t frame, std::size_t first, std::size_t count, const FramesView<T>& out) {
  for (std::size_t row = 0; row < out.rows; ++row) {
    const T* const from = block + row * kWidth<T>;
    if (out.column_stride == 1)
      std::copy_n(from, count, out.at(frame, row, first));
    else
      for (std::size_t c = 0; c < count; ++c) out(frame, row, first + c) = from[c];
  }
}

// Z = X₁ + j·X₂ of two real columns becomes G₁·X₁ + j·G₂·X₂, with X₁ = (Z(k) + Z*(−k))/2 and j·X₂ = (Z(k) − Z*(−k))/2.
// values: (length) in the order of the DFT.
void filter_pair(const Filter& one, const Filter& two, std::span<const std::size_t> order,
                 std::span<std::complex<double>> values) {
  const std::size_t length = values.size();
  const auto first = both_halves(one, length), second = both_halves(two, length);
  std::vector<std::complex<double>> spectrum(length);
  for (std::size_t n = 0; n < length; ++n) spectrum[order[n]] = values[n];
  for (std::size_t n = 0; n < length; ++n) {
    const std::size_t k = order[n];
    const auto own = spectrum[k], opposite = std::conj(spectrum[k == 0 ? 0 : length - k]);
    values[n] = 0.5 * (first[k] * (own + opposite) + second[k] * (own - opposite));
  }
}

template <class T>
class BlockEqualizer {
 public:
  BlockEqualizer(const Plan& plan, std::size_t count, double max_boost)
      : plan_(plan),
        count_(count),
        max_boost_(max_boost),
        pairs_(std::min(count, kWidth<T> / 2)),
        block_(memory_.block.at_least(plan.response.length * kWidth<T>)) {
    memory_.terms.resize(static_cast<std::size_t>(plan.ends.terms.rows()) * kWidth<T>);
    for (auto* values : {&memory_.mean, &memory_.slope, &memory_.reach, &memory_.units, &memory_.scale,
                         &memory_.less_mean, &memory_.less_slope})
      values->resize(kWidth<T>);
    memory_.column.resize(plan.rows);
  }

  [[nodiscard]] T* block() { return block_; }  // (rows × width)

  // Equalises the block in place. noise (count, or empty: estimated), noise_gain and assumed (count). restored: sum
  // over the columns of the restored fraction of the amplitude (bins, or empty).
  void run(std::span<const double> noise, std::span<double> noise_gain, std::span<double> assumed,
           std::span<double> restored) {
    const kernels::ColumnLines lines{memory_.mean.data(), memory_.slope.data(), memory_.reach.data()};
    kernels::equalizer_loops<T>().column_lines(block(), plan_.rows, kWidth<T>, lines);
    const auto height = static_cast<double>(plan_.rows);
    for (std::size_t c = 0; c < kWidth<T>; ++c) {
      check_light<T>(std::abs(memory_.mean[c]) + memory_.reach[c] + std::abs(memory_.slope[c]) * height);
      memory_.units[c] = unit_of(memory_.reach[c]);
      memory_.scale[c] = memory_.units[c] > 0 ? 1 / memory_.units[c] : 1;
      memory_.less_mean[c] = -memory_.scale[c] * memory_.mean[c];
      memory_.less_slope[c] = -memory_.scale[c] * memory_.slope[c];
    }
    kernels::equalizer_loops<T>().add_lines(block(), plan_.rows, kWidth<T>,
                                            {memory_.less_mean.data(), memory_.less_slope.data(), nullptr},
                                            memory_.scale.data(), 0);
    const auto analysed = analyse(noise);
    extend();
    filter(analysed, noise_gain, restored);
    for (std::size_t c = 0; c < analysed.size(); ++c) {
      assumed[c] = std::sqrt(analysed[c].rest.noise) / memory_.scale[c];
      for (std::size_t n = 0; n < analysed[c].course.size(); ++n)
        block_[n * kWidth<T> + c] += static_cast<T>(analysed[c].course[n]);
    }
    kernels::equalizer_loops<T>().add_lines(block(), plan_.rows, kWidth<T>, lines, memory_.units.data(),
                                            plan_.exposure_rows / 2);
  }

 private:
  // A power of two of the size of the columns: squares neither overflow nor vanish, and two columns in one complex
  // signal share no rounding errors. 0 for a steady column.
  static double unit_of(double reach) {
    if (!(reach > 0)) return 0;
    return std::exp2(std::max(std::ilogb(reach), std::numeric_limits<T>::min_exponent));
  }

  // Takes the course of each column off; empty for the inverse.
  std::vector<ColumnAnalysis::Result> analyse(std::span<const double> noise) {
    if (!plan_.analysis) return {};
    std::vector<ColumnAnalysis::Result> analysed(count_);
    for (std::size_t c = 0; c < count_; ++c) {
      check_interrupt();
      if (!noise.empty() && noise[c] == 0) continue;
      // Beyond these the filter is the same, and squares of squares stay finite.
      const double scaled = noise.empty() ? 1 : std::clamp(noise[c] * memory_.scale[c], 1 / kMostLight, kMostLight);
      for (std::size_t n = 0; n < plan_.rows; ++n) memory_.column[n] = static_cast<double>(block_[n * kWidth<T> + c]);
      analysed[c] = plan_.analysis->take_off_course(memory_.column,
                                                    noise.empty() ? std::nullopt : std::optional(scaled * scaled));
      for (std::size_t n = 0; n < plan_.rows; ++n) block_[n * kWidth<T> + c] = static_cast<T>(memory_.column[n]);
    }
    return analysed;
  }

  // Behind the rows: their continuation after the end, zeros, their continuation before the start.
  void extend() {
    const auto& tables = plan_.template in<T>();
    const Continuation& ends = plan_.ends;
    const std::size_t length = plan_.response.length;
    const auto stride = static_cast<std::ptrdiff_t>(kWidth<T>);
    const auto row = [&](std::size_t n) { return block() + n * kWidth<T>; };
    const auto end = [&](const T* nearest, std::ptrdiff_t inwards, T* next) {
      const auto terms = static_cast<std::size_t>(ends.terms.rows());
      T* const of_terms = memory_.terms.data();
      kernels::equalizer_loops<T>().matrix_times_rows(tables.terms.data(), terms, ends.used, nearest, inwards, of_terms,
                                                      stride, kWidth<T>);
      kernels::equalizer_loops<T>().matrix_times_rows(tables.smooth.data(), ends.predicted, terms - ends.near,
                                                      of_terms + ends.near * kWidth<T>, stride, next, -inwards,
                                                      kWidth<T>);
      for (std::size_t i = 0; i < ends.near; ++i, next -= inwards)
        for (std::size_t c = 0; c < kWidth<T>; ++c) next[c] += of_terms[i * kWidth<T> + c];
    };
    end(row(plan_.rows - 1), -stride, row(plan_.rows));
    end(row(0), stride, row(length - 1));
    std::fill(row(plan_.rows + ends.predicted), row(length - ends.predicted), T{0});
  }

  void filter(const std::vector<ColumnAnalysis::Result>& analysed, std::span<double> noise_gain,
              std::span<double> restored) {
    const auto& tables = plan_.template in<T>();
    std::vector<Filter> own(analysed.size());
    for (std::size_t c = 0; c < own.size(); ++c) own[c] = filter_of_column(analysed[c]);
    const auto used = [&](std::size_t c) -> const Filter& {
      return c < own.size() && !own[c].gain.empty() ? own[c] : plan_.inverse;
    };
    for (std::size_t c = 0; c < count_; ++c) {
      noise_gain[c] = used(c).noise_gain;
      for (std::size_t k = 0; k < restored.size(); ++k) restored[k] += used(c).restored[k];
    }
    if (std::ranges::all_of(own, [](const Filter& filter) { return filter.gain.empty(); }))
      return tables.dft.filter(block_, tables.gain.data(), pairs_);
    tables.dft.forward(block_, pairs_);
    std::vector<std::complex<double>> values(tables.dft.length());
    for (std::size_t c = 0; c < pairs_; ++c) {
      T* const real = block_ + c;
      T* const imaginary = real + kWidth<T> / 2;
      for (std::size_t n = 0; n < values.size(); ++n) values[n] = {real[n * kWidth<T>], imaginary[n * kWidth<T>]};
      filter_pair(used(c), used(c + kWidth<T> / 2), tables.dft.order(), values);
      for (std::size_t n = 0; n < values.size(); ++n) {
        real[n * kWidth<T>] = static_cast<T>(values[n].real());
        imaginary[n * kWidth<T>] = static_cast<T>(values[n].imag());
      }
    }
    tables.dft.inverse(block_, pairs_);
  }

  // Empty for the inverse.
  [[nodiscard]] Filter filter_of_column(const ColumnAnalysis::Result& analysed) const {
    if (analysed.course.empty()) return {};
    auto gain = plan_.analysis->gain(analysed.rest);
    for (auto& value : gain)
      if (const double size = std::abs(value); size > max_boost_) value *= max_boost_ / size;
    return filter_of(std::move(gain), plan_.response);
  }

  static Memory<T>& kept() {
    thread_local Memory<T> memory;
    return memory;
  }

  const Plan& plan_;
  std::size_t count_;
  double max_boost_;
  std::size_t pairs_;
  Memory<T>& memory_ = kept();
  T* block_;
};

// Bands (cycles per row) whose restored amplitude is below 1/2.
std::vector<Interval> bands_lost(std::span<const double> restored, const Response& response) {
  std::vector<Interval> bands;
  const auto excess = [&](std::size_t k) { return restored[k] - 0.5; };
  bool inside = false;
  for (std::size_t k = 0; k < restored.size(); ++k) {
    const bool lost = excess(k) < 0;
    if (lost == inside) continue;
    const double crossing = k == 0 ? 0 : static_cast<double>(k) - excess(k) / (excess(k) - excess(k - 1));
    if (lost)
      bands.push_back({response.frequency(crossing), kInfinity});
    else
      bands.back().high = response.frequency(crossing);
    inside = lost;
  }
  if (!inside) bands.push_back({0.5, kInfinity});
  return bands;
}

// No exposure: identity. An exposure of the whole frame or more: only the mean remains.
template <class T>
EqualizerReport without_dft(const AnyFramesView& frames, const Camera& camera, const FramesView<T>& out) {
  const bool identity = *camera.exposure == 0;
  const std::size_t columns = out.frames * out.columns;
  for (std::size_t frame = 0; frame < out.frames; ++frame)
    for (std::size_t first = 0; first < out.columns; first += kWidth<T>) {
      check_interrupt();
      const std::size_t count = std::min(kWidth<T>, out.columns - first);
      const auto signals = column_signals(frames, frame, first, count, camera.tone_curve);
      for (const double light : signals) check_light<T>(light);
      for (std::size_t c = 0; c < count; ++c) {
        const auto signal = std::span(signals).subspan(c * out.rows, out.rows);
        const double mean = mean_of(signal);
        for (std::size_t row = 0; row < out.rows; ++row)
          out(frame, row, first + c) = static_cast<T>(identity ? signal[row] : mean);
      }
    }
  EqualizerReport report;
  report.frequencies_lost = {{identity ? 0.5 / camera.row_time : 0, kInfinity}};
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

}  // namespace

std::vector<Interval> lost_frequencies(const Camera& camera, double max_boost) {
  check(camera);
  check_max_boost(max_boost);
  const double exposure = known_exposure(camera, "equalisation");
  const double highest = 0.5 / camera.row_time;
  const double level = 1 / (std::numbers::sqrt2 * max_boost);
  std::vector<Interval> bands;
  for (const auto& [low, high] : cycles_below({1}, level, std::min(exposure * highest, kMostNulls))) {
    if (!(high < exposure * highest)) {
      bands.push_back({std::min(low / exposure, highest), kInfinity});
      return bands;
    }
    bands.push_back({low / exposure, high / exposure});
  }
  bands.push_back({highest, kInfinity});
  return bands;
}

namespace {

template <class T>
EqualizerReport equalize_as(const AnyFramesView& frames, const Camera& camera, const EqualizerSettings& settings,
                            const FramesView<T>& out) {
  check(camera);
  check(frames);
  const Shape shape = shape_of(frames);
  const double exposure_rows = known_exposure(camera, "equalisation") / camera.row_time;
  const std::size_t columns = shape.frames * shape.columns;
  check_settings(settings, columns);
  require(out.frames == shape.frames && out.rows == shape.rows && out.columns == shape.columns, "out", "another shape",
          "the shape of columns");
  if (exposure_rows == 0 || exposure_rows >= static_cast<double>(shape.rows)) return without_dft(frames, camera, out);

  const auto plan = plan_of({shape.rows, exposure_rows, settings.max_boost, settings.method});
  EqualizerReport report{{}, std::vector<double>(columns), std::vector<double>(columns)};
  const std::size_t per_frame = (shape.columns + kWidth<T> - 1) / kWidth<T>;
  const std::size_t blocks = shape.frames * per_frame;
  const bool inverse = settings.method == EqualizerMethod::inverse;
  const std::size_t bins = inverse ? 0 : plan->inverse.restored.size();
  std::vector<double> restored(blocks * bins);  // of each block: their sum does not depend on the threads
  for_each_block(blocks, settings.threads, [&](std::size_t index) {
    const std::size_t frame = index / per_frame, first = index % per_frame * kWidth<T>;
    const std::size_t count = std::min(kWidth<T>, shape.columns - first), at = frame * shape.columns + first;
    std::vector<double> noise;
    if (settings.noise.size() == 1) noise.assign(count, settings.noise[0]);
    if (settings.noise.size() > 1) noise.assign(&settings.noise[at], &settings.noise[at] + count);
    BlockEqualizer<T> block(*plan, count, settings.max_boost);
    light_rows(frames, frame, first, count, camera.tone_curve, kWidth<T>, block.block());
    block.run(noise, std::span(report.noise_gain).subspan(at, count), std::span(report.noise).subspan(at, count),
              std::span(restored).subspan(index * bins, bins));
    store(block.block(), frame, first, count, out);
  });
  if (inverse) {
    report.frequencies_lost = lost_frequencies(camera, settings.max_boost);
    return report;
  }
  std::vector<double> mean(bins);
  for (std::size_t i = 0; i < restored.size(); ++i) mean[i % bins] += restored[i] / static_cast<double>(columns);
  report.frequencies_lost = bands_lost(mean, plan->response);
  for (auto& band : report.frequencies_lost) band = {band.low / camera.row_time, band.high / camera.row_time};
  return report;
}

}  // namespace

EqualizerReport equalize(const AnyFramesView& frames, const Camera& camera, const EqualizerSettings& settings,
                         const FramesView<double>& out) {
  return equalize_as(frames, camera, settings, out);
}

EqualizerReport equalize(const AnyFramesView& frames, const Camera& camera, const EqualizerSettings& settings,
                         const FramesView<float>& out) {
  return equalize_as(frames, camera, settings, out);
}

}  // namespace ocisac
