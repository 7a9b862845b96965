#include "columns/lamp_slope.hpp"

#include <algorithm>
#include <cmath>

#include "core/levels.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr Index kWindowRows = 60;
constexpr Index kMinWindows = 4;
constexpr double kMinLight = 0.2;   // relative to the largest: blocks of a window, or windows, below it are without it
constexpr double kSlopeErrors = 6;  // standard errors

// Light in a window of rows: its mean row, and centroid and standard deviation along the columns.
struct Centroid {
  double row = 0, column = 0, spread = 0, swing = 0;
};

// Loadings by one step of the power method from the strongest block. `window`: (rows × blocks), from row `begin` on.
Centroid window_centroid(const ConstMatrix& window, const VectorXd& centres, Index begin) {
  Index strongest = 0;
  window.colwise().squaredNorm().maxCoeff(&strongest);
  VectorXd common = window.col(strongest), loadings;
  for (int step = 0; step < 2; ++step) {
    loadings = window.transpose() * common;
    loadings = (loadings.array() < kMinLight * loadings.maxCoeff()).select(0.0, loadings);
    common = window * loadings;
  }
  if (!(loadings.maxCoeff() > 0)) return {};
  const double sum = loadings.sum(), energy = common.squaredNorm(), column = loadings.dot(centres) / sum;
  const auto rows =
      VectorXd::LinSpaced(common.size(), static_cast<double>(begin), static_cast<double>(begin + common.size() - 1));
  return {common.cwiseAbs2().dot(rows) / energy, column,
          std::sqrt(loadings.dot((centres.array() - column).square().matrix()) / sum),
          std::sqrt(energy) / loadings.squaredNorm()};
}

}  // namespace

double lamp_slope(const ConstMatrix& swings, const VectorXd& centres) {
  const Index rows = swings.rows(), windows = rows / kWindowRows;
  if (centres.size() < 3 || windows < kMinWindows) return 0;
  std::vector<Centroid> found;
  double strongest = 0;
  for (Index window = 0; window < windows; ++window) {
    const Index begin = window * rows / windows, end = (window + 1) * rows / windows;
    found.push_back(window_centroid(swings.middleRows(begin, end - begin), centres, begin));
    strongest = std::max(strongest, found.back().swing);
  }
  std::erase_if(found, [&](const Centroid& light) { return !(light.swing > kMinLight * strongest); });
  const auto count = static_cast<Index>(found.size());
  if (count < kMinWindows) return 0;
  // A centroid's variance is inverse to the power of its window.
  VectorXd weights(count), row(count), column(count), spread(count);
  for (Index k = 0; k < count; ++k) {
    const Centroid& light = found[static_cast<std::size_t>(k)];
    weights(k) = light.swing * light.swing, row(k) = light.row, column(k) = light.column, spread(k) = light.spread;
  }
  weights /= weights.sum();
  const double movement = row(count - 1) - row(0), wide = weights.dot(spread);
  row.array() -= weights.dot(row);
  column.array() -= weights.dot(column);
  const double moment = weights.dot(row.cwiseAbs2()), slope = weights.dot(row.cwiseProduct(column)) / moment;
  const double left = weights.dot((column - slope * row).cwiseAbs2());
  const double error = std::sqrt(left / static_cast<double>(count - 2) / moment);
  return std::abs(slope) > kSlopeErrors * error && std::abs(slope) * movement > kMostly * wide ? slope : 0.0;
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
