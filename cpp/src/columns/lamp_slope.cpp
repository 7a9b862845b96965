#include "columns/lamp_slope.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>

#include "core/levels.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kWindowRows = 60;
constexpr std::size_t kMinWindows = 4;
constexpr double kMinLight = 0.2;   // relative to the largest: blocks of a window, or windows, below it are without it
constexpr double kSlopeErrors = 6;  // standard errors

// Light in a window of rows: its mean row, and centroid and standard deviation along the columns.
struct Centroid {
  double row = 0, column = 0, spread = 0, swing = 0;
};

// Loadings by one step of the power method from the strongest block.
Centroid window_centroid(std::span<const double> swings, std::span<const double> centres, std::size_t begin,
                         std::size_t end) {
  const std::size_t rows = swings.size() / centres.size();
  const auto block = [&](std::size_t index) { return swings.subspan(index * rows + begin, end - begin); };
  const auto power = [&](std::size_t index) {
    return std::inner_product(block(index).begin(), block(index).end(), block(index).begin(), 0.0);
  };
  std::size_t strongest = 0;
  double most = 0;
  for (std::size_t index = 0; index < centres.size(); ++index)
    if (const double now = power(index); now > most) {
      most = now;
      strongest = index;
    }
  std::vector<double> common(block(strongest).begin(), block(strongest).end()), loadings(centres.size());
  double largest = 0;
  for (int step = 0; step < 2; ++step) {
    for (std::size_t index = 0; index < centres.size(); ++index)
      loadings[index] = std::inner_product(common.begin(), common.end(), block(index).begin(), 0.0);
    largest = *std::ranges::max_element(loadings);
    std::ranges::fill(common, 0.0);
    for (std::size_t index = 0; index < centres.size(); ++index) {
      if (loadings[index] < kMinLight * largest) loadings[index] = 0;
      for (std::size_t row = 0; row < common.size(); ++row) common[row] += loadings[index] * block(index)[row];
    }
  }
  if (!(largest > 0)) return {};
  Centroid found;
  const double sum = std::accumulate(loadings.begin(), loadings.end(), 0.0);
  const double squares = std::inner_product(loadings.begin(), loadings.end(), loadings.begin(), 0.0);
  found.column = std::inner_product(loadings.begin(), loadings.end(), centres.begin(), 0.0) / sum;
  double moment = 0, energy = 0;
  for (std::size_t index = 0; index < centres.size(); ++index)
    moment += loadings[index] * std::pow(centres[index] - found.column, 2);
  for (std::size_t row = 0; row < common.size(); ++row) {
    const double square = common[row] * common[row];
    energy += square;
    found.row += square * static_cast<double>(begin + row);
  }
  found.row /= energy;
  found.spread = std::sqrt(moment / sum);
  found.swing = std::sqrt(energy) / squares;
  return found;
}

}  // namespace

double lamp_slope(std::span<const double> swings, std::span<const double> centres) {
  const std::size_t rows = centres.empty() ? 0 : swings.size() / centres.size(), windows = rows / kWindowRows;
  if (centres.size() < 3 || windows < kMinWindows) return 0;
  std::vector<Centroid> found;
  double strongest = 0;
  for (std::size_t window = 0; window < windows; ++window) {
    found.push_back(window_centroid(swings, centres, window * rows / windows, (window + 1) * rows / windows));
    strongest = std::max(strongest, found.back().swing);
  }
  std::erase_if(found, [&](const Centroid& light) { return !(light.swing > kMinLight * strongest); });
  if (found.size() < kMinWindows) return 0;
  const auto count = static_cast<double>(found.size());
  // A centroid's variance is inverse to the power of its window.
  double power = 0, row = 0, column = 0, spread = 0, moment = 0, product = 0, left = 0;
  for (const Centroid& light : found) power += light.swing * light.swing;
  for (const Centroid& light : found) {
    const double weight = light.swing * light.swing / power;
    row += weight * light.row;
    column += weight * light.column;
    spread += weight * light.spread;
  }
  for (const Centroid& light : found) {
    const double weight = light.swing * light.swing / power;
    moment += weight * std::pow(light.row - row, 2);
    product += weight * (light.row - row) * (light.column - column);
  }
  const double slope = product / moment;
  for (const Centroid& light : found)
    left += light.swing * light.swing / power * std::pow(light.column - column - slope * (light.row - row), 2);
  const double error = std::sqrt(left / (count - 2) / moment);
  const double movement = std::abs(slope) * (found.back().row - found.front().row);
  return std::abs(slope) > kSlopeErrors * error && movement > kMostly * spread ? slope : 0.0;
}

UprightFrame::UprightFrame(const AnyFramesView& frames, std::size_t frame, double slope) {
  std::visit(
      [&]<class T>(const FramesView<const T>& all) {
        const double middle = 0.5 * static_cast<double>(all.rows - 1);
        const std::size_t half = (all.columns - 1) / 2;
        const auto most = static_cast<double>(half);
        std::vector<std::ptrdiff_t> moved(all.rows);
        for (std::size_t row = 0; row < all.rows; ++row)
          moved[row] = std::lround(std::clamp(slope * (static_cast<double>(row) - middle), -most, most));
        const auto [low, high] = std::ranges::minmax(moved);
        columns_ = all.columns;
        width_ = columns_ - static_cast<std::size_t>(high - low);
        for (const std::ptrdiff_t columns : moved) first_.push_back(static_cast<std::size_t>(columns - low));
        copy(all.frame(frame));
      },
      frames);
}

template <class T>
void UprightFrame::copy(const FramesView<const T>& view) {
  std::vector<T> pixels(view.rows * width_);
  for (std::size_t row = 0; row < view.rows; ++row)
    if (view.column_stride == 1)
      std::copy_n(view.at(0, row, first_[row]), width_, &pixels[row * width_]);
    else
      for (std::size_t column = 0; column < width_; ++column)
        pixels[row * width_ + column] = view(0, row, first_[row] + column);
  pixels_ = std::move(pixels);
}

AnyFramesView UprightFrame::view() const {
  return std::visit(
      [&]<class T>(const std::vector<T>& pixels) -> AnyFramesView {
        return dense_view<const T>(pixels.data(), 1, first_.size(), width_);
      },
      pixels_);
}

std::vector<double> UprightFrame::own_weights(std::span<const double> weights) const {
  std::vector<double> own(columns_, 0.0), share(columns_ - width_ + 1, 0.0);  // of the rows that begin at a column
  for (const std::size_t first : first_) share[first] += 1 / static_cast<double>(first_.size());
  for (std::size_t first = 0; first < share.size(); ++first)
    for (std::size_t column = 0; column < width_; ++column) own[first + column] += share[first] * weights[column];
  return own;
}

}  // namespace ocisac
