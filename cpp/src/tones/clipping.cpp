#include "tones/clipping.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <type_traits>
#include <utility>

#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/tones/tone_gain.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kRows = 64;   // few: looking at them takes 1 % of the time of a gain
constexpr std::size_t kFewest = 4;  // samples that are a pile, or not chance

// Visits samples of some rows.
template <class T>
void for_some(const FramesView<const T>& view, std::size_t frame, std::size_t column, double cycles_per_row,
              auto visit) {
  const auto [first, end] = columns_about(column, view.columns, 16);
  const std::size_t width = end - first, count = std::min(view.rows, 16 * kRows / width);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t row = count < view.rows ? some_row(i, view.rows, cycles_per_row) : i;
    const T* const samples = view.at(frame, row, first);
    for (std::size_t c = 0; c < width; ++c) visit(samples[static_cast<std::ptrdiff_t>(c) * view.column_stride]);
  }
}

// `samples`: in order, at least two of them different.
template <class T>
double smallest_step(const std::vector<T>& samples) {
  double step = static_cast<double>(samples.back() - samples.front());
  for (std::size_t i = 1; i < samples.size(); ++i)
    if (samples[i] != samples[i - 1]) step = std::min(step, static_cast<double>(samples[i] - samples[i - 1]));
  return step;
}

// `sign` −1: the highest.
template <class T>
std::optional<Pile> lowest(std::vector<T>& samples, int sign) {
  const auto before = [sign](T a, T b) { return sign > 0 ? a < b : b < a; };
  T level = samples[0];
  for (const T sample : samples) level = before(sample, level) ? sample : level;
  const auto at = static_cast<std::size_t>(std::ranges::count(samples, level));
  if (at < kFewest || at == samples.size()) return {};
  T beside = level;
  for (const T sample : samples)
    if (sample != level && (beside == level || before(sample, beside))) beside = sample;
  if ((level == T{0} ? 2 * at : at) <= static_cast<std::size_t>(std::ranges::count(samples, beside))) return {};
  std::ranges::sort(samples);
  return Pile{static_cast<double>(level), static_cast<double>(beside), smallest_step(samples)};
}

// A counter as wide as a sample, so that compilers make one vector operation of many columns.
template <class T>
using CountOf =
    std::conditional_t<sizeof(T) == 1, std::uint8_t,
                       std::conditional_t<sizeof(T) == 2, std::uint16_t,
                                          std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>>>;

template <class Count>
void count(Count& to, bool is) {
  to = static_cast<Count>(to + (is ? 1 : 0));
}

}  // namespace

// The sequence of Roberts, of least discrepancy in two dimensions: multiples of 1/p and 1/p², p³ = p + 1.
std::size_t some_row(std::size_t i, std::size_t rows, double cycles_per_row) {
  constexpr double kPlastic = 1.32471795724474602596;
  const auto part = [i](double of) {
    const double all = static_cast<double>(i) * of;
    return all - static_cast<double>(static_cast<std::size_t>(all));
  };
  const double height = static_cast<double>(rows), cycles = std::max(std::floor(cycles_per_row * height), 1.0),
               cycle = std::floor(cycles * part(1 / kPlastic)), phase = part(1 / (kPlastic * kPlastic));
  const auto row = static_cast<std::size_t>((cycle + phase) / std::max(cycles_per_row, 1 / height));
  return std::min(row, rows - 1);
}

Piles find_piles(const AnyFramesView& frames, std::size_t frame, std::size_t column, double least,
                 double cycles_per_row) {
  return std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        std::vector<T> samples;
        samples.reserve(16 * kRows);
        for_some(view, frame, column, cycles_per_row, [&](T sample) { samples.push_back(sample); });
        const auto below =
            std::ranges::count_if(samples, [least](T sample) { return static_cast<double>(sample) < least; });
        return Piles{lowest(samples, 1), lowest(samples, -1), static_cast<std::size_t>(below) >= kFewest};
      },
      frames);
}

IndexRange columns_about(std::size_t column, std::size_t columns, std::size_t most) {
  const std::size_t width = std::min(most, columns),
                    first = std::min(column - std::min(column, width / 2), columns - width);
  return {first, first + width};
}

Eigen::MatrixXd samples_of_pairs(const AnyFramesView& frames, std::size_t frame, IndexRange columns, std::size_t pairs,
                                 double cycles_per_row) {
  return std::visit(
      [&](const auto& view) {
        const std::size_t count = 2 * std::min(view.rows - 1, pairs);
        Eigen::MatrixXd samples(static_cast<Eigen::Index>(columns.size()), static_cast<Eigen::Index>(count));
        for (std::size_t n = 0; n < count; ++n) {
          const auto* from = view.at(frame, some_row(n / 2, view.rows - 1, cycles_per_row) + n % 2, columns.begin);
          for (double& sample : samples.col(static_cast<Eigen::Index>(n))) {
            sample = static_cast<double>(*from);
            from += view.column_stride;
          }
        }
        return samples;
      },
      frames);
}

double step_of_samples(const AnyFramesView& frames) {
  return std::visit(
      []<class T>(const FramesView<const T>& view) {
        if (view.frames == 0) return std::is_integral_v<T> ? 1.0 : 0.0;
        const std::size_t width = std::min<std::size_t>(16, view.columns), left = (view.columns - width) / 2,
                          count = std::min(view.rows, kRows);
        if constexpr (std::is_integral_v<T>) {
          // A few samples tell the step 1, which is that of nearly all frames.
          const std::int64_t first = *view.at(0, 0, left);
          std::int64_t step = 0;
          for (std::size_t i = 0; i < count && step != 1; ++i)
            for (std::size_t c = 0; c < width && step != 1; ++c)
              step = std::gcd(step, std::int64_t{view(0, i * view.rows / count, left + c)} - first);
          return step > 0 ? static_cast<double>(step) : 1.0;
        } else {
          std::vector<T> samples;
          for (std::size_t i = 0; i < count; ++i)
            for (std::size_t c = 0; c < width; ++c) samples.push_back(view(0, i * view.rows / count, left + c));
          if (!std::ranges::all_of(samples, [](T sample) { return std::isfinite(sample); })) return 0.0;  // no order
          std::ranges::sort(samples);
          const double step = smallest_step(samples);
          const auto is_off = [&](T sample) {
            const double steps = static_cast<double>(sample - samples.front()) / step;
            return !(std::abs(steps - std::nearbyint(steps)) < kNextToNone);
          };
          return std::ranges::any_of(samples, is_off) ? 0.0 : step;
        }
      },
      frames);
}

// Rounded samples at −j count j: the first by its probability, the others by an integral.
double lost_at_black(double level, double deviation, double off) {
  if (level > 2 * kSure * deviation) return 0;
  const double more = (level + 1) / deviation;
  const double lost = normal_tail((level + 0.5) / deviation) +
                      deviation * std::exp(-more * more / 2) / std::sqrt(kTwoPi) - (level + 1) * normal_tail(more);
  return std::min(lost, std::max(level - off, 0.0)) / normal_tail((level - 0.5) / deviation);
}

PileCounts count_pile(const AnyFramesView& frames, std::size_t frame, const Pile& pile) {
  return std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        const auto zeros = [&] { return std::vector<std::uint32_t>(view.columns); };
        PileCounts counts{zeros(), zeros(), zeros(), zeros()};
        const T level = static_cast<T>(pile.level), beside = static_cast<T>(pile.beside);
        std::vector<T> copied(view.columns);
        std::vector<CountOf<T>> was_at(view.columns);
        const auto most = static_cast<std::size_t>(std::numeric_limits<CountOf<T>>::max());
        for (std::size_t first = 0; first < view.rows; first += std::min(most, view.rows)) {
          auto at = std::vector<CountOf<T>>(view.columns), near = at, beyond = at, runs = at;
          for (std::size_t n = first; n < first + std::min(most, view.rows - first); ++n) {
            const T* row = view.at(frame, n, 0);
            if (view.column_stride != 1) {
              for (std::size_t c = 0; c < view.columns; ++c) copied[c] = view(frame, n, c);
              row = copied.data();
            }
            if (level < beside)
              for (std::size_t c = 0; c < view.columns; ++c) count(beyond[c], row[c] < level);
            else
              for (std::size_t c = 0; c < view.columns; ++c) count(beyond[c], row[c] > level);
            for (std::size_t c = 0; c < view.columns; ++c) count(near[c], row[c] == beside);
            for (std::size_t c = 0; c < view.columns; ++c) {
              const CountOf<T> is_at = row[c] == level ? 1 : 0;
              count(at[c], row[c] == level);
              count(runs[c], is_at > was_at[c]);
              was_at[c] = is_at;
            }
          }
          for (std::size_t c = 0; c < view.columns; ++c) {
            counts.at[c] += static_cast<std::uint32_t>(at[c]);
            counts.beside[c] += static_cast<std::uint32_t>(near[c]);
            counts.beyond[c] += static_cast<std::uint32_t>(beyond[c]);
            counts.runs[c] += static_cast<std::uint32_t>(runs[c]);
          }
        }
        return counts;
      },
      frames);
}

}  // namespace ocisac
