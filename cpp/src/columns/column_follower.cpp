#include "ocisac/columns/column_follower.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <type_traits>

#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_combination.hpp"

namespace ocisac {

namespace {

constexpr double kMinLoading = 0.1;       // of the largest: columns below are next to the light
constexpr double kClippedShare = 0.01;    // of the rows: columns with more of them saturated are left out
constexpr double kClippingLevel = 0.98;   // of the white level
constexpr std::size_t kLanes = 8;         // sums side by side, for the compiler to vectorise
constexpr std::size_t kClippingStep = 8;  // rows from one that is looked at for saturation to the next

// `signal` less its moving mean over 2·reach + 1 rows, at the ends over as many as there are.
void take_swings(std::span<const double> signal, std::size_t reach, std::span<double> swings) {
  double sum = std::accumulate(signal.begin(),
                               signal.begin() + static_cast<std::ptrdiff_t>(std::min(reach, signal.size())), 0.0);
  std::size_t count = std::min(reach, signal.size());
  for (std::size_t n = 0; n < signal.size(); ++n) {
    if (n + reach < signal.size()) sum += signal[n + reach], ++count;
    if (n > reach) sum -= signal[n - reach - 1], --count;
    swings[n] = signal[n] - sum / static_cast<double>(count);
  }
}

template <class T>
FramesView<const T> columns_of(FramesView<const T> view, std::size_t first, std::size_t count) {
  view.data = view.at(0, 0, first);
  view.columns = count;
  return view;
}

}  // namespace

template <class T>
double ColumnFollower::light(T value) const {
  if constexpr (std::is_integral_v<T>)
    if (!table_.empty()) return table_[value];
  if (curve_.kind == ToneCurve::Kind::linear) return static_cast<double>(value) - curve_.dark_level;
  return linear_light(curve_, static_cast<double>(value), sample_maximum<T>());
}

// signal = Σ weight·light, the weights' sum being 1: for linear light the dark level comes off at the end.
template <class T>
void ColumnFollower::weigh(const FramesView<const T>& view) {
  const bool dense = view.column_stride == 1 && curve_.kind == ToneCurve::Kind::linear;
  const std::size_t whole = dense ? view.columns / kLanes * kLanes : 0;
  for (std::size_t row = 0; row < view.rows; ++row) {
    std::array<double, kLanes> sums{};
    const T* values = view.at(0, row, 0);
    for (std::size_t column = 0; column < whole; column += kLanes)
      for (std::size_t lane = 0; lane < kLanes; ++lane)
        sums[lane] += weights_[column + lane] * static_cast<double>(values[column + lane]);
    double sum = std::accumulate(sums.begin(), sums.end(), 0.0);
    if (dense) sum -= curve_.dark_level;
    for (std::size_t column = whole; column < view.columns; ++column)
      sum += weights_[column] * (light(view(0, row, column)) + (dense ? curve_.dark_level : 0));
    signal_[row] = sum;
  }
}

template <class T>
void ColumnFollower::update(const FramesView<const T>& view) {
  take_swings(signal_, signal_.size() / 16 + 1, swings_);
  std::ranges::fill(loadings_, 0.0);
  const bool dense = view.column_stride == 1 && curve_.kind == ToneCurve::Kind::linear;
  for (std::size_t row = 0; row < view.rows; ++row) {
    const double swing = swings_[row];
    const T* values = view.at(0, row, 0);
    if (dense)
      for (std::size_t column = 0; column < view.columns; ++column)
        loadings_[column] += swing * static_cast<double>(values[column]);
    else
      for (std::size_t column = 0; column < view.columns; ++column)
        loadings_[column] += swing * light(view(0, row, column));
  }
  std::ranges::fill(clipped_, 0);
  const bool has_top = std::is_integral_v<T> || curve_.white_level != 0;
  const double level =
      has_top ? kClippingLevel * white_level(curve_, sample_maximum<T>()) : std::numeric_limits<double>::infinity();
  for (std::size_t row = 0; row < view.rows; row += kClippingStep)
    for (std::size_t column = 0; column < view.columns; ++column)
      clipped_[column] += static_cast<double>(view(0, row, column)) >= level;
}

void ColumnFollower::start(const AnyFramesView& frame, std::size_t first, std::size_t count) {
  first_ = first;
  const auto part = std::visit([&](const auto& view) { return AnyFramesView(columns_of(view, first, count)); }, frame);
  auto combined = combine_columns(part, 0, curve_);
  weights_ = std::move(combined.weights);
  signal_ = std::move(combined.signal);
  saturated_ = combined.saturated;
  swings_.resize(signal_.size());
  loadings_.resize(count);
  clipped_.resize(count);
  std::visit(
      [&]<class T>(const FramesView<const T>&) {
        if constexpr (std::is_integral_v<T>) {
          if (curve_.kind == ToneCurve::Kind::linear || !table_.empty()) return;
          table_.resize(std::size_t{std::numeric_limits<T>::max()} + 1);
          for (std::size_t value = 0; value < table_.size(); ++value)
            table_[value] = linear_light(curve_, static_cast<double>(value), sample_maximum<T>());
        }
      },
      frame);
}

// The columns looked at move by half of what the light has moved off their middle.
void ColumnFollower::centre(std::size_t columns) {
  double sum = 0, moment = 0;
  for (std::size_t column = 0; column < loadings_.size(); ++column) {
    sum += loadings_[column];
    moment += loadings_[column] * static_cast<double>(column);
  }
  if (!(sum > 0)) return;
  const double off = moment / sum - 0.5 * static_cast<double>(loadings_.size() - 1);
  const auto min_step = -static_cast<std::ptrdiff_t>(first_);
  const auto max_step = static_cast<std::ptrdiff_t>(columns - first_ - count());
  const std::ptrdiff_t step = std::clamp(static_cast<std::ptrdiff_t>(0.5 * off), min_step, max_step);
  if (step == 0) return;
  first_ = static_cast<std::size_t>(static_cast<std::ptrdiff_t>(first_) + step);
  if (step > 0)
    std::fill(std::shift_left(loadings_.begin(), loadings_.end(), step), loadings_.end(), 0.0);
  else
    std::fill(loadings_.begin(), std::shift_right(loadings_.begin(), loadings_.end(), -step), 0.0);
}

std::span<const double> ColumnFollower::combine(const AnyFramesView& frame, bool can_move) {
  std::visit(
      [&](const auto& all) {
        const auto view = columns_of(all, first_, count());
        weigh(view);
        update(view);
      },
      frame);
  const std::size_t looked_at = (signal_.size() + kClippingStep - 1) / kClippingStep;
  const auto rows = static_cast<double>(looked_at);
  const auto is_clipped = [&](std::size_t column) {
    return static_cast<double>(clipped_[column]) > kClippedShare * rows;
  };
  const double largest = *std::ranges::max_element(loadings_);
  double sum = 0;
  bool saturated = false;
  for (const bool leave_out : {true, false}) {  // saturated columns only where there are no others
    sum = 0;
    for (std::size_t column = 0; column < loadings_.size(); ++column) {
      const bool counts = loadings_[column] >= kMinLoading * largest && !(leave_out && is_clipped(column));
      if (counts) sum += loadings_[column];
    }
    saturated = !leave_out;
    if (sum > 0) break;
  }
  if (!(sum > 0)) return signal_;  // dark: the weights stay
  saturated_ = saturated;
  for (std::size_t column = 0; column < loadings_.size(); ++column)
    if (loadings_[column] < kMinLoading * largest || (!saturated && is_clipped(column))) loadings_[column] = 0;
  if (can_move) centre(std::visit([](const auto& view) { return view.columns; }, frame));
  sum = std::accumulate(loadings_.begin(), loadings_.end(), 0.0);
  if (sum > 0)
    for (std::size_t column = 0; column < loadings_.size(); ++column) weights_[column] = loadings_[column] / sum;
  return signal_;
}

}  // namespace ocisac
