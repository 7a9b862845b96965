#include "lights/screening.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <numeric>
#include <type_traits>

#include "columns/dense_rows.hpp"
#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
#include "lights/screening_kernels.hpp"
#include "ocisac/camera/linear_light.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kHop = kernels::kChunkRows, kWindow = 2 * kHop;  // rows of a tile, after summing
constexpr std::size_t kTileGroups = 3;                                 // per tile
constexpr std::size_t kWideFactor = 8;  // a second family of scales, for faint light on large areas
constexpr double kMinShare = 0.4;
constexpr float kMinPower = 1e-6F;  // mean square of log light: swings below 0.1 % are ignored
// Cycles in a window; half steps where the tiles of the next scale have no better resolution.
constexpr std::array<double, 18> kCycles{2.5, 3, 3.5, 4, 4.5, 5, 5.5, 6, 6.5, 7, 7.5, 8, 9, 10, 11, 12, 13, 14};

// Cosines and sines about the middle of a window, with mean and slope removed, so that those of a signal do not matter:
// of rows 31, 30, … 16 (16 × waves).
struct Waves {
  static constexpr std::size_t kPadded = 24;  // number of waves in whole vectors
  std::array<std::array<float, kPadded>, kHop> cosine{}, sine{};
  float slope_energy = 0;  // Σ (n − 15.5)²

  Waves() {
    for (std::size_t n = 0; n < kHop; ++n) slope_energy += static_cast<float>(2 * from_middle(n) * from_middle(n));
    for (std::size_t k = 0; k < kCycles.size(); ++k) {
      const auto turn = [&](std::size_t n) { return kTwoPi * kCycles[k] * from_middle(n) / kWindow; };
      double mean = 0, tilt = 0;
      for (std::size_t n = 0; n < kHop; ++n) {
        mean += std::cos(turn(n)) / kHop;
        tilt += 2 * std::sin(turn(n)) * from_middle(n) / static_cast<double>(slope_energy);
      }
      for (std::size_t n = 0; n < kHop; ++n) {
        cosine[n][k] = static_cast<float>(std::cos(turn(n)) - mean);
        sine[n][k] = static_cast<float>(std::sin(turn(n)) - tilt * from_middle(n));
      }
    }
  }

  // Position of row 31 − n relative to the middle.
  static double from_middle(std::size_t n) { return 0.5 * (kWindow - 1) - static_cast<double>(n); }
};

const Waves& waves() {
  static const Waves one;
  return one;
}

struct BestWave {
  float amount = 0;  // its energy, or its share of a tile's; 0: none
  std::uint8_t wave = 0;
};

// The strongest wave in the common signal of a tile's groups; `tile`: its first group.
BestWave strongest_wave(const kernels::Chunk& earlier, const kernels::Chunk& later, std::size_t tile,
                        std::size_t stride, std::size_t groups) {
  const Waves& all = waves();
  float step = 0;
  for (std::size_t g = tile; g < tile + groups; ++g) step += later.first[g] - earlier.first[g];
  std::array<float, Waves::kPadded> a, b;
  kernels::wave_sums(earlier.common + tile, later.common + tile, step, stride, all.cosine[0].data(), all.sine[0].data(),
                     Waves::kPadded, a.data(), b.data());
  BestWave best;
  for (std::size_t k = 0; k < kCycles.size(); ++k) {
    const float energy = 2.0F / kWindow * (a[k] * a[k] + b[k] * b[k]);
    if (energy > best.amount) best = {energy, static_cast<std::uint8_t>(k)};
  }
  return best;
}

std::size_t windows_in(std::size_t rows) { return rows < kWindow ? 0 : (rows - kWindow) / kHop + 1; }

bool alike(std::uint8_t a, std::uint8_t b) { return std::abs(kCycles[a] - kCycles[b]) <= 1; }

// Suspects from tiles (windows × across) that touch, corners included, and agree in frequency.
void add_suspects(const std::vector<BestWave>& tiles, std::size_t across, std::size_t groups, std::size_t row_step,
                  std::size_t column_step, std::vector<Suspect>& suspects) {
  std::vector<std::uint8_t> open(tiles.size());
  std::ranges::transform(tiles, open.begin(), [](const BestWave& tile) { return tile.amount != 0; });
  const auto joined = [&](std::size_t a, std::size_t b) { return alike(tiles[a].wave, tiles[b].wave); };
  for (std::size_t start = 0; start < tiles.size(); ++start) {
    if (!open[start]) continue;
    Suspect suspect{};
    visit_connected(start, across, open, joined, [&](std::size_t at, const Region& place) {
      const auto [share, wave] = tiles[at];
      const Region box{place.x * column_step, place.y * kHop * row_step, groups * column_step, kWindow * row_step};
      suspect.box = suspect.evidence > 0 ? hull(suspect.box, box) : box;
      suspect.evidence -= std::log1p(-static_cast<double>(share));
      if (share > suspect.share) {
        suspect.share = static_cast<double>(share);
        suspect.frequency = kCycles[wave] / static_cast<double>(kWindow * row_step);
        suspect.best = box;
      }
    });
    suspects.push_back(suspect);
  }
}

// Threshold of the share that white noise exceeds `false_alarms` times in this number of tiles.
double share_threshold(std::size_t tiles, std::size_t groups, double false_alarms) {
  const double tests = static_cast<double>(std::max<std::size_t>(tiles, 1) * kCycles.size());
  const double half_freedom = (static_cast<double>(groups * (kWindow - 2)) - 2) / 2;
  return std::max(kMinShare, 1 - std::pow(std::min(false_alarms / tests, 1.0), 1 / half_freedom));
}

// Log light of one scale, row by row: two chunks of 16 rows form a window. Sums of two rows and of neighbouring groups
// form the next scales.
class Scale {
 public:
  // `widen`: with wide and coarser scales.
  Scale(std::size_t rows, std::size_t groups, std::size_t row_step, std::size_t column_step, bool by_rows, bool widen)
      : rows_(rows),
        groups_(groups),
        row_step_(row_step),
        column_step_(column_step),
        stride_(groups + kernels::kChunkPadding),
        logs_(2 * kernels::kChunkRows * stride_),
        common_(logs_.size()),
        previous_(stride_),
        energy_(stride_) {
    for (auto& values : scratch_) values.resize(stride_);
    for (auto& values : moments_) values.resize(2 * stride_);
    if (widen && groups >= kTileGroups * kWideFactor)
      wide_ = std::make_unique<Scale>(rows, groups / kWideFactor, row_step, column_step * kWideFactor, by_rows, false);
    if (widen && rows / 2 >= kWindow) {
      across_ = groups > 1 && !by_rows ? 2 : 1;
      half_ = std::make_unique<Scale>(rows / 2, groups / across_, 2 * row_step, across_ * column_step, by_rows, true);
    }
    light_.resize(std::max(wide_ ? wide_->groups_ : 0, half_ ? half_->groups_ : 0));
  }

  // Number of tiles of this scale and those derived from it.
  [[nodiscard]] std::size_t tiles() const {
    return windows_in(rows_) * groups_ + (wide_ ? wide_->tiles() : 0) + (half_ ? half_->tiles() : 0);
  }

  void begin(float floor, float min_swing, double false_alarms, std::size_t all_tiles) {
    floor_ = floor;
    min_swing_ = min_swing;
    threshold_ = share_threshold(all_tiles, tile_width(), false_alarms);
    if (wide_) wide_->begin(floor, min_swing, false_alarms, all_tiles);
    if (half_) half_->begin(floor, min_swing, false_alarms, all_tiles);
  }

  // `light`: mean light of every group in the next row, DN above dark.
  void add_row(const float* light) {
    const std::size_t slot = seen_ % (2 * kernels::kChunkRows);
    kernels::logarithms(light, groups_, floor_, &logs_[slot * stride_]);
    if (wide_) add_to_wide(light);
    if (half_ && seen_ % 2 == 0) std::copy(light, light + groups_, previous_.begin());
    if (half_ && seen_ % 2 == 1) add_to_half(light);
    ++seen_;
    if (seen_ % kernels::kChunkRows == 0) end_chunk();
  }

  void collect(std::vector<Suspect>& suspects) const {
    if (wide_) wide_->collect(suspects);
    add_suspects(tiles_, tiles_across(), tile_width(), row_step_, column_step_, suspects);
    if (half_) half_->collect(suspects);
  }

 private:
  [[nodiscard]] std::size_t tile_width() const { return std::min(kTileGroups, groups_); }
  [[nodiscard]] std::size_t tiles_across() const { return groups_ - tile_width() + 1; }

  void add_to_wide(const float* light) {
    for (std::size_t g = 0; g < wide_->groups_; ++g) {
      float sum = 0;
      for (std::size_t k = 0; k < kWideFactor; ++k) sum += light[g * kWideFactor + k];
      light_[g] = sum / static_cast<float>(kWideFactor);
    }
    wide_->add_row(light_.data());
  }

  void add_to_half(const float* light) {
    const std::size_t second = across_ - 1;
    for (std::size_t g = 0; g < half_->groups_; ++g) {
      const std::size_t at = across_ * g;
      light_[g] = 0.25F * (previous_[at] + previous_[at + second] + light[at] + light[at + second]);
    }
    half_->add_row(light_.data());
  }

  void end_chunk() {
    check_interrupt();
    const std::size_t chunks = seen_ / kernels::kChunkRows, later = (chunks - 1) % 2;
    kernels::chunk_moments(stride_, groups_, tile_width(), chunk(later));
    if (chunks > 1) end_window(1 - later, later);
  }

  // The common share of a tile is a cheap upper bound for that of any tone in it; tones are evaluated only where it
  // reaches the threshold.
  void end_window(std::size_t earlier, std::size_t later) {
    const std::size_t first = tiles_.size();
    tiles_.resize(first + tiles_across());
    const kernels::Chunk a = chunk(earlier), b = chunk(later);
    const auto count = static_cast<float>(tile_width());
    const auto threshold = static_cast<float>(threshold_);
    const kernels::WindowScratch scratch{scratch_[0].data(), scratch_[1].data(), scratch_[2].data(),
                                         scratch_[3].data(), scratch_[4].data(), scratch_[5].data()};
    if (!kernels::tile_energies(a, b, tiles_across(),
                                {tile_width(), kMinPower * kWindow * count, threshold, waves().slope_energy}, scratch,
                                energy_.data()))
      return;
    for (std::size_t g = 0; g < tiles_across(); ++g) {
      const float energy = energy_[g];
      if (energy == 0) continue;
      float mean = 0;  // of log light
      for (std::size_t k = 0; k < tile_width(); ++k) mean += (a.first[g + k] + scratch.sum[g + k] / kWindow) / count;
      const float swing = min_swing_ * std::exp(-mean);
      if (energy < 0.5F * swing * swing * kWindow * count) continue;
      const BestWave tone = strongest_wave(a, b, g, stride_, tile_width());
      const float share = tone.amount / (count * energy);
      if (share >= threshold) tiles_[first + g] = {std::min(share, 0.9999F), tone.wave};
    }
  }

  [[nodiscard]] kernels::Chunk chunk(std::size_t which) {
    const auto part = [&](std::size_t k) { return moments_[k].data() + which * stride_; };
    const std::size_t at = which * kernels::kChunkRows * stride_;
    return {&logs_[at], part(0), part(1), part(2), part(3), part(4), &common_[at]};
  }

  std::size_t rows_, groups_, row_step_, column_step_, stride_, across_ = 1, seen_ = 0;
  float floor_ = 0, min_swing_ = 0;
  double threshold_ = 1;
  std::vector<float> logs_, common_;           // (2 chunks × 16 rows)
  std::array<std::vector<float>, 5> moments_;  // (2 chunks), as of Chunk
  std::vector<float> previous_, light_;
  std::array<std::vector<float>, 6> scratch_;  // of a window, as of WindowScratch
  std::vector<float> energy_;                  // of its tiles
  std::vector<BestWave> tiles_;                // (windows × across)
  std::unique_ptr<Scale> wide_, half_;
};

// Uses stored values: a memoryless tone curve preserves every period.
template <class T>
void add_rows(const FramesView<const T>& view, std::size_t group, float dark, Scale& scale) {
  constexpr std::size_t kBlock = 256;
  const std::size_t groups = view.columns / group;
  const float factor = 1.0F / static_cast<float>(group);
  DenseRows<T, T> source(view, 0, {});
  std::vector<float> light(groups);
  for (std::size_t first = 0; first < view.rows; first += kBlock) {
    const auto block = source.read(first, std::min(kBlock, view.rows - first), {0, view.columns});
    for (std::size_t n = 0; n < block.rows; ++n) {
      const T* const row = block.samples + static_cast<std::ptrdiff_t>(n) * block.stride;
      if (std::is_same_v<T, std::uint8_t> && group == 8)
        kernels::sum_eight_bytes(reinterpret_cast<const std::uint8_t*>(row), groups, factor, dark, light.data());
      else
        for (std::size_t g = 0; g < groups; ++g)
          light[g] = std::accumulate(row + g * group, row + (g + 1) * group, 0.0F) * factor - dark;
      scale.add_row(light.data());
    }
  }
}

void move(Region& box, const Region& by) { box.x += by.x, box.y += by.y; }

}  // namespace

std::vector<Suspect> screen_sources(const LitFrame& frame, const Region& region, double false_alarms, bool by_rows) {
  const AnyFramesView frames = part_of(frame.frames, region);
  const auto floor = static_cast<float>(frame.floor);
  const Shape shape = shape_of(frames);
  const std::size_t group = std::clamp<std::size_t>(shape.columns / (2 * kTileGroups), 1, kWidestGroup);
  const float min_swing = holds_integers(frames) ? 0.5F : 0.0F;  // a tone of less than half a stored step is ignored
  Scale finest(shape.rows, shape.columns / group, 1, group, by_rows, true);
  finest.begin(floor, min_swing, false_alarms, finest.tiles());
  std::visit(
      [&](const auto& view) { add_rows(view.frame(frame.index), group, static_cast<float>(frame.dark), finest); },
      frames);
  std::vector<Suspect> suspects;
  finest.collect(suspects);
  std::ranges::stable_sort(suspects, std::greater{}, &Suspect::evidence);
  for (Suspect& suspect : suspects) {
    move(suspect.box, region), move(suspect.best, region);
  }
  return suspects;
}

}  // namespace ocisac
