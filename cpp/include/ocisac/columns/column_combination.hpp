// Combination of pixel columns into one signal: selection of the columns with light, and their weights.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

struct CombinedColumn {
  std::vector<double> signal;   // (rows), linear light, DN above dark
  std::vector<double> weights;  // (columns), sum 1; 0: not used
  double noise = 0;             // standard deviation of `signal` about the common light; NaN for a single column
  double quality = 0;           // power of the common light over noise after combination; single column: its power
  double slope = 0;             // columns per row, by lamp_slope; 0 where only some columns were asked for
  bool saturated = false;       // columns with saturated pixels had to be used, or no others exist
  // (rows) mean light of the columns with little of the common light; empty without such, and for followed frames
  std::vector<double> beside{};
  bool has_sides = false;  // the light is within the frame's width: next to none of it at both its edges
  bool left_out = false;   // columns with saturated pixels were left out
};

// Fraction of the rows in which each column of a frame is saturated, see saturation_level().
std::vector<double> saturated_share(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve);

inline constexpr double kTogether = 0.6;  // least correlation of swings of one light

// Columns dominated by one of several lights.
struct LightGroup {
  std::vector<std::uint8_t> columns;  // (columns) 1: member
  std::vector<double> swings;         // (rows) its swings about their moving mean, normalised to length 1
};

// Lights side by side, the strongest first: groups of columns whose swings correlate with each other (cosine above
// kTogether) and not with another group's (below 0.3). Empty where all columns may have one light. Saturated columns
// belong to no group.
std::vector<LightGroup> light_groups(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve);

// The columns of a frame combined, and its lights beside each other, read once.
struct ColumnLights {
  CombinedColumn combined;  // without `slope` and `beside`
  std::vector<LightGroup> groups;
};
ColumnLights column_lights(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve);

// Cosine between a signal's swings about their moving mean and a group's.
double agreement(std::span<const double> signal, const LightGroup& group);

// Weights that maximise the signal-to-noise ratio under a one-factor model of the columns' covariance (one common
// light, independent noise and texture per column): gain over own variance. Neighbouring columns share a weight.
// `columns`: 1 for allowed columns, empty for all. Columns with saturated pixels are left out if others remain, unless
// they are to be used.
CombinedColumn combine_columns(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                               bool use_saturated = false, std::span<const std::uint8_t> columns = {});

// (rows) Linear light above dark of a frame's columns, each times its weight, (columns), and added up.
std::vector<double> weighted_rows(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                                  std::span<const double> weights);

struct BlockedFrame;

// combine_columns for successive frames of one light. The first frame's weights are estimated in full; later every
// second frame takes one step of the factor model from the previous weights, in O(blocks · rows) instead of
// O(blocks² · rows). The frames between use the weights of the frame before, unless the light moved. Frames of a light
// that moves along the columns from row to row are sheared upright first, by the slope found so far.
class ColumnFollower {
 public:
  explicit ColumnFollower(const ToneCurve& curve);
  ColumnFollower(ColumnFollower&&) noexcept;
  ColumnFollower& operator=(ColumnFollower&&) noexcept;
  ~ColumnFollower();

  // `frame`: one picture. A full estimate follows a change of width, or previous weights that give no signal. `hold`:
  // the weights stay those of the frame before, so that frames can be compared row by row.
  CombinedColumn combine(const AnyFramesView& frame, bool hold = false);

  // Shifts the weights: the next frame begins so many columns further right.
  void move(std::ptrdiff_t columns);

  // The next frame gets a full estimate of the weights.
  void forget();

 private:
  CombinedColumn combine_as_stored(const AnyFramesView& frame, bool hold);
  CombinedColumn combine_upright(const AnyFramesView& frame, bool hold);

  ToneCurve curve_;
  std::vector<double> weights_;              // (columns) of the last frame
  CombinedColumn last_;                      // noise, quality, saturation and slope at the last estimate
  std::size_t age_ = 0;                      // frames since the last full estimate
  bool moved_ = false;                       // since the last estimate: the next frame needs one
  bool has_streaks_ = false;                 // when last examined: other light is in a few columns for some rows
  std::unique_ptr<BlockedFrame> memory_;     // reused from frame to frame
  double slope_ = 0;                         // columns per row, by which frames are sheared
  std::unique_ptr<ColumnFollower> upright_;  // of the sheared frames; its weights are averaged over the rows
};

// One-factor model C = a·aᵀ + diag(v) of a covariance (size × size) by principal-factor iteration.
struct CommonFactor {
  std::vector<double> loadings;  // a
  std::vector<double> own;       // v
};
CommonFactor common_factor(std::span<const double> covariance, std::size_t size);

}  // namespace ocisac
