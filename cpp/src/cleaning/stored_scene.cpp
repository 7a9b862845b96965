#include "ocisac/cleaning/stored_scene.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <variant>

#include "cleaning/block_shares.hpp"
#include "cleaning/merged_blocks.hpp"
#include "cleaning/quantile.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kMostMerged = 8;   // columns in each
constexpr double kRelativeNoise = 1e-4;  // of the largest value
constexpr double kBlack = 2e-4;          // of white, below which a toe has no slope

// Second differences along every so many rows, where bands cancel.
void add_bends(const AnyFramesView& colour, std::size_t every, std::vector<double>& bends) {
  std::visit(
      [&](const auto& view) {
        const auto value = [&](std::size_t frame, std::size_t n, std::size_t k) {
          return static_cast<double>(view(frame, n, k));
        };
        for (std::size_t frame = 0; frame < view.frames; ++frame)
          for (std::size_t n = 0; n < view.rows; n += every)
            for (std::size_t k = 0; k + 2 < view.columns; ++k)
              bends.push_back(std::abs(value(frame, n, k + 2) - 2 * value(frame, n, k + 1) + value(frame, n, k)));
      },
      colour);
}

double largest_magnitude(const AnyFramesView& colour) {
  double most = 0;
  std::visit(
      [&](const auto& view) {
        for (std::size_t frame = 0; frame < view.frames; ++frame)
          for (std::size_t n = 0; n < view.rows; ++n)
            for (std::size_t k = 0; k < view.columns; ++k)
              most = std::max(most, std::abs(static_cast<double>(view(frame, n, k))));
      },
      colour);
  return most;
}

// Noise, DN; at least half a step of integers.
double noise_of(std::span<const AnyFramesView> colours, const Shape& shape) {
  double least = 0.5;
  if (!holds_integers(colours.front())) {
    double most = 1e-100;
    for (const AnyFramesView& colour : colours) most = std::max(most, largest_magnitude(colour));
    least = kRelativeNoise * most;
  }
  if (shape.columns < 3) return least;
  const std::size_t samples = shape.frames * shape.rows * shape.columns * colours.size();
  std::vector<double> bends;
  for (const AnyFramesView& colour : colours)
    add_bends(colour, std::max<std::size_t>(2, samples / (2 * kEnoughPixels)), bends);
  return std::max(least, quantile(bends, 0.5) / (kMedianMagnitude * std::sqrt(6.0)));
}

}  // namespace

double lifted_light(double stored, double toe, double white) {
  if (toe == 0) return stored;
  const double size = std::abs(stored);
  return std::copysign(0.5 * (size + std::sqrt(size * (size + 4 * toe * white))), stored);
}

double slope_of_lifted(double stored, double toe, double white) {
  if (toe == 0) return 1;
  const double size = std::max(std::abs(stored), kBlack * white);
  return 0.5 + 0.5 * (size + 2 * toe * white) / std::sqrt(size * (size + 4 * toe * white));
}

void check_stored(std::optional<double> noise, double toe) {
  require(!noise || (std::isfinite(*noise) && *noise >= 1e-100), "noise", noise.value_or(0),
          "a finite number, 1e-100 or above");
  require(toe >= 0 && toe <= 1, "toe", toe, "0 to 1");
}

StoredScene::StoredScene(std::vector<AnyFramesView> colours, const ToneCurve& curve, std::optional<double> noise,
                         double toe, bool is_read)
    : colours_(std::move(colours)), curve_(curve) {
  require(!colours_.empty(), "colours", 0, "at least one");
  const Shape shape = shape_of(colours_.front());
  for (const AnyFramesView& colour : colours_) {
    check(colour);
    const Shape own = shape_of(colour);
    require(colour.index() == colours_.front().index() && own.frames == shape.frames && own.rows == shape.rows &&
                own.columns == shape.columns,
            "colours", colours_.size(), "views of one shape and type");
  }
  require(shape.rows >= 8, "frames", shape.rows, "at least 8 rows");
  check_stored(noise, toe);
  frames_ = shape.frames;
  rows_ = shape.rows;
  columns_ = shape.columns;
  merged_ = std::min(blocks_of(rows_ * columns_, kWholePixels), kMostMerged);
  white_ = white_level(curve_, sample_maximum(colours_.front())) - curve_.dark_level;
  noise_ = noise || !is_read ? noise.value_or(0.5) : noise_of(colours_, shape);
  if (is_read) set_toe(toe);
}

void StoredScene::set_toe(double toe) {
  toe_ = toe;
  if (holds_integers(colours_.front())) make_table();
  pictures_.clear();
  for (std::size_t frame = 0; frame < frames_; ++frame)
    for (std::size_t colour = 0; colour < colours_.size(); ++colour) pictures_.push_back(converted(frame, colour));
}

double StoredScene::variance_at(double value, double top) const {
  const double deviation =
      noise_ * light_per_step(curve_, value, top) * slope_of_lifted(linear_light(curve_, value, top), toe_, white_);
  return value >= saturation_level(colours_.front(), curve_) ? kInfinity : deviation * deviation;
}

void StoredScene::make_table() {
  const double top = sample_maximum(colours_.front());
  const auto count = static_cast<std::size_t>(top) + 1;
  const auto lit = [&](double value) { return lifted_light(linear_light(curve_, value, top), toe_, white_); };
  table_ = {};
  for (std::size_t k = 0; k < count; ++k) {
    const auto value = static_cast<double>(k);
    table_.light.push_back(k == 0 ? lit(value) : std::max(lit(value), table_.light.back()));
    table_.variance.push_back(variance_at(value, top));
    if (k + 1 < count)
      table_.bounds.push_back(k == 0 ? lit(value + 0.5) : std::max(lit(value + 0.5), table_.bounds.back()));
  }
}

Blocks StoredScene::converted(std::size_t frame, std::size_t colour) const {
  return std::visit(
      [&]<class Sample>(const FramesView<const Sample>& view) {
        const FramesView<const Sample> plane = view.frame(frame);
        if constexpr (std::is_integral_v<Sample>) {
          return merge_columns(plane, merged_, table_);
        } else {
          Blocks blocks{rows_, columns_, {}, {}};
          for (std::size_t i = 0; i < rows_ * columns_; ++i) {
            const double value = static_cast<double>(plane(0, i / columns_, i % columns_));
            blocks.light.push_back(lifted_light(linear_light(curve_, value, 1), toe_, white_));
            blocks.variance.push_back(variance_at(value, 1));
          }
          return block_means(blocks.picture(), 1, merged_);
        }
      },
      colours_[colour]);
}

BandedPicture StoredScene::picture(std::size_t frame, std::size_t colour) const {
  return pictures_[frame * colours_.size() + colour].picture();
}

std::vector<BandedPicture> StoredScene::colours_of(std::size_t frame) const {
  std::vector<BandedPicture> result;
  for (std::size_t colour = 0; colour < colours(); ++colour) result.push_back(picture(frame, colour));
  return result;
}

template <class Sample>
void StoredScene::restore(std::size_t frame, std::size_t colour, const BlockShares& shares, const Restoration& to,
                          const RestoredPicture<Sample>& result) const {
  const auto* const view = std::get_if<FramesView<const Sample>>(&colours_.at(colour));
  require(view != nullptr && by_table() && frame < frames_, "frame", frame, "a frame of samples of this type");
  restore_picture<Sample>(view->frame(frame), shares, to, table_, result);
}

template void StoredScene::restore(std::size_t, std::size_t, const BlockShares&, const Restoration&,
                                   const RestoredPicture<std::uint8_t>&) const;
template void StoredScene::restore(std::size_t, std::size_t, const BlockShares&, const Restoration&,
                                   const RestoredPicture<std::uint16_t>&) const;

}  // namespace ocisac
