#include "tones/clipping.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

namespace ocisac {

namespace {

constexpr std::size_t kRows = 64;   // few: looking at them takes 1 % of the time of a gain
constexpr std::size_t kFewest = 4;  // samples that are a pile, or not chance

// Visits samples of rows at places of low discrepancy, so that no period of the light hides others.
template <class T>
void for_some(const FramesView<const T>& view, std::size_t frame, std::size_t column, std::size_t columns, auto visit) {
  constexpr std::uint32_t kGolden = 2654435769;  // 2³² times the golden ratio's part
  const std::size_t width = std::min(columns, view.columns);
  const std::size_t first = std::min(column - std::min(column, width / 2), view.columns - width);
  const std::size_t count = std::min(view.rows, kRows * columns / width);
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::size_t row = count < view.rows ? std::uint64_t{i * kGolden} * view.rows >> 32U : i;
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
  if (at <= static_cast<std::size_t>(std::ranges::count(samples, beside))) return {};
  std::ranges::sort(samples);
  return Pile{static_cast<double>(level), static_cast<double>(beside), smallest_step(samples)};
}

}  // namespace

Piles find_piles(const AnyFramesView& frames, std::size_t frame, std::size_t column, double least) {
  return std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        std::vector<T> samples;
        samples.reserve(16 * kRows);
        for_some(view, frame, column, 16, [&](T sample) { samples.push_back(sample); });
        const auto below =
            std::ranges::count_if(samples, [least](T sample) { return static_cast<double>(sample) < least; });
        return Piles{lowest(samples, 1), lowest(samples, -1), static_cast<std::size_t>(below) >= kFewest};
      },
      frames);
}

double least_of_some(const AnyFramesView& frames, std::size_t frame, std::size_t column) {
  return std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        T least = std::numeric_limits<T>::max();
        for_some(view, frame, column, 4, [&](T sample) { least = std::min(least, sample); });
        return static_cast<double>(least);
      },
      frames);
}

PileCounts count_pile(const AnyFramesView& frames, std::size_t frame, const Pile& pile) {
  return std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        const auto zeros = [&] { return std::vector<std::uint32_t>(view.columns); };
        PileCounts counts{zeros(), zeros(), zeros(), zeros()};
        const bool is_low = pile.level < pile.beside;
        const auto level = static_cast<T>(pile.level), beside = static_cast<T>(pile.beside);
        std::vector<std::uint32_t> was_at = zeros();
        for (std::size_t row = 0; row < view.rows; ++row)
          for (std::size_t c = 0; c < view.columns; ++c) {
            const T value = view(frame, row, c);
            const std::uint32_t is_at = value == level;
            counts.at[c] += is_at;
            counts.beside[c] += value == beside;
            counts.beyond[c] += is_low ? value < level : value > level;
            counts.runs[c] += is_at & ~was_at[c];
            was_at[c] = is_at;
          }
        return counts;
      },
      frames);
}

}  // namespace ocisac
