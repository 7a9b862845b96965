#include "ocisac/receiver/source_screening.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <numbers>

namespace ocisac {

namespace {

constexpr std::size_t window = 32, hop = 16;  // rows of a tile, after adding
constexpr std::size_t most_groups = 3;        // in a tile
constexpr std::size_t widest_group = 8;       // columns at the finest scale
constexpr std::size_t wide_factor = 8;        // a second family of scales, for faint light on wide areas
constexpr double least_share = 0.4;
constexpr float least_power = 1e-6F;  // mean square of log light: swings below 0.1 % are nobody's
// Cycles in a window: by halves where the tiles of the next scale do not see better.
constexpr std::array<double, 18> cycles{2.5, 3, 3.5, 4, 4.5, 5, 5.5, 6, 6.5, 7, 7.5, 8, 9, 10, 11, 12, 13, 14};

// Mean light of groups of neighbouring columns, (rows × groups), DN above dark.
struct Reduced {
  std::size_t rows, groups;
  std::size_t row_step, column_step;  // pixels in an element
  std::vector<float> light;
};

// Sum of eight bytes.
std::uint32_t sum_of_bytes(const std::uint8_t* bytes) {
  constexpr std::uint64_t low = 0x00ff00ff00ff00ffU;
  std::uint64_t x;
  std::memcpy(&x, bytes, sizeof x);
  x = (x & low) + ((x >> 8) & low);
  x += x >> 32;
  return static_cast<std::uint32_t>((x + (x >> 16)) & 0xffffU);
}

template <class T>
void sum_row(const T* row, std::ptrdiff_t stride, std::size_t group, std::size_t groups, float scale, float dark,
             float* out) {
  if constexpr (std::is_same_v<T, std::uint8_t>)
    if (stride == 1 && group == 8) {
      for (std::size_t g = 0; g < groups; ++g)
        out[g] = static_cast<float>(static_cast<std::int32_t>(sum_of_bytes(row + 8 * g))) * scale - dark;
      return;
    }
  for (std::size_t g = 0; g < groups; ++g) {
    float sum = 0;
    for (std::size_t c = 0; c < group; ++c)
      sum += static_cast<float>(row[static_cast<std::ptrdiff_t>(g * group + c) * stride]);
    out[g] = sum * scale - dark;
  }
}

// Columns lie in memory one after the other: each is added up as it lies, 16 groups at a time.
template <class T>
void sum_columns(const FramesView<const T>& view, std::size_t group, float scale, float dark, Reduced& out) {
  constexpr std::size_t side = 16;
  std::vector<float> sums(side * view.rows);
  for (std::size_t first = 0; first < out.groups; first += side) {
    const std::size_t count = std::min(side, out.groups - first);
    std::fill(sums.begin(), sums.end(), 0.0F);
    for (std::size_t g = 0; g < count; ++g)
      for (std::size_t c = 0; c < group; ++c) {
        const T* column = view.at(0, 0, (first + g) * group + c);
        float* sum = &sums[g * view.rows];
        if (view.row_stride == 1)
          for (std::size_t n = 0; n < view.rows; ++n) sum[n] += static_cast<float>(column[n]);
        else
          for (std::size_t n = 0; n < view.rows; ++n)
            sum[n] += static_cast<float>(column[static_cast<std::ptrdiff_t>(n) * view.row_stride]);
      }
    for (std::size_t n = 0; n < view.rows; ++n)
      for (std::size_t g = 0; g < count; ++g)
        out.light[n * out.groups + first + g] = sums[g * view.rows + n] * scale - dark;
  }
}

// A memoryless tone curve keeps every period: stored values do.
template <class T>
Reduced reduced(const FramesView<const T>& view, double dark) {
  const std::size_t group = std::clamp<std::size_t>(view.columns / (2 * most_groups), 1, widest_group);
  Reduced out{view.rows, view.columns / group, 1, group, {}};
  out.light.resize(out.rows * out.groups);
  const float scale = 1.0F / static_cast<float>(group);
  if (std::abs(view.row_stride) < std::abs(view.column_stride)) {
    sum_columns(view, group, scale, static_cast<float>(dark), out);
  } else {
    for (std::size_t n = 0; n < view.rows; ++n)
      sum_row(view.at(0, n, 0), view.column_stride, group, out.groups, scale, static_cast<float>(dark),
              &out.light[n * out.groups]);
  }
  return out;
}

Reduced half(const Reduced& fine) {
  Reduced out{fine.rows / 2, std::max<std::size_t>(fine.groups / 2, 1), 2 * fine.row_step, 2 * fine.column_step, {}};
  const std::size_t second = fine.groups > 1 ? 1 : 0;
  if (second == 0) out.column_step = fine.column_step;
  out.light.resize(out.rows * out.groups);
  for (std::size_t n = 0; n < out.rows; ++n) {
    const float* upper = &fine.light[2 * n * fine.groups];
    const float* lower = upper + fine.groups;
    for (std::size_t g = 0; g < out.groups; ++g)
      out.light[n * out.groups + g] =
          0.25F * (upper[2 * g] + upper[2 * g + second] + lower[2 * g] + lower[2 * g + second]);
  }
  return out;
}

Reduced widened(const Reduced& fine) {
  Reduced out{fine.rows, fine.groups / wide_factor, fine.row_step, fine.column_step * wide_factor, {}};
  out.light.resize(out.rows * out.groups);
  for (std::size_t n = 0; n < out.rows; ++n)
    for (std::size_t g = 0; g < out.groups; ++g) {
      float sum = 0;
      for (std::size_t k = 0; k < wide_factor; ++k) sum += fine.light[n * fine.groups + g * wide_factor + k];
      out.light[n * out.groups + g] = sum / static_cast<float>(wide_factor);
    }
  return out;
}

// ln x to 1e-5 for x > 0, in a form that compilers turn into SIMD: ln m = 2·artanh((m − 1)/(m + 1)).
float logarithm(float x) {
  const auto bits = std::bit_cast<std::int32_t>(x);
  const auto exponent = static_cast<float>((bits >> 23) - 127);
  const auto mantissa = std::bit_cast<float>((bits & 0x007fffff) | 0x3f800000);
  const float t = (mantissa - 1) / (mantissa + 1), t2 = t * t;
  return exponent * std::numbers::ln2_v<float> + 2 * t * (1 + t2 * (1.0F / 3 + t2 * (0.2F + t2 / 7)));
}

void take_logarithm(Reduced& reduced, float floor) {
  for (float& value : reduced.light) value = logarithm(std::max(value, 0.0F) + floor);
}

struct Waves {
  std::array<std::array<float, window>, cycles.size()> cosine, sine;
  std::array<float, window> slope;  // −15.5 … 15.5
  float slope_energy = 0;

  Waves() {
    for (std::size_t n = 0; n < window; ++n) {
      slope[n] = static_cast<float>(n) - 0.5F * (window - 1);
      slope_energy += slope[n] * slope[n];
      for (std::size_t k = 0; k < cycles.size(); ++k) {
        const double turn = 2 * std::numbers::pi * cycles[k] * static_cast<double>(n) / window;
        cosine[k][n] = static_cast<float>(std::cos(turn));
        sine[k][n] = static_cast<float>(std::sin(turn));
      }
    }
  }
};

const Waves& waves() {
  static const Waves one;
  return one;
}

// Σx, Σx·slope and Σx² of many signals side by side.
struct Moments {
  std::vector<float> sum, slope, square;
  explicit Moments(std::size_t count) : sum(count), slope(count), square(count) {}

  void clear() {
    for (auto* values : {&sum, &slope, &square}) std::fill(values->begin(), values->end(), 0.0F);
  }
  void add(const float* x, float position) {
    float* a = sum.data();
    float* b = slope.data();
    float* c = square.data();
    const std::size_t count = sum.size();
    for (std::size_t i = 0; i < count; ++i) {
      a[i] += x[i];
      b[i] += position * x[i];
      c[i] += x[i] * x[i];
    }
  }
  // Energy beyond mean and slope.
  [[nodiscard]] float energy(std::size_t i) const {
    return square[i] - sum[i] * sum[i] / window - slope[i] * slope[i] / waves().slope_energy;
  }
};

struct Tile {
  float share = 0;  // 0: nothing
  std::uint8_t wave = 0;
};

struct Tone {
  double energy = 0;
  std::uint8_t wave = 0;
};

// The strongest of the waves in the sum of `groups` neighbouring groups.
Tone strongest_tone(const float* first, std::size_t stride, std::size_t groups) {
  std::array<float, window> x{};
  float mean = 0, slope = 0;
  for (std::size_t n = 0; n < window; ++n) {
    for (std::size_t g = 0; g < groups; ++g) x[n] += first[n * stride + g];
    mean += x[n] / window;
    slope += x[n] * waves().slope[n] / waves().slope_energy;
  }
  for (std::size_t n = 0; n < window; ++n) x[n] -= mean + slope * waves().slope[n];
  Tone best;
  for (std::size_t k = 0; k < cycles.size(); ++k) {
    float a = 0, b = 0;
    for (std::size_t n = 0; n < window; ++n) {
      a += x[n] * waves().cosine[k][n];
      b += x[n] * waves().sine[k][n];
    }
    const double energy = 2.0 / window * static_cast<double>(a * a + b * b);
    if (energy > best.energy) best = {energy, static_cast<std::uint8_t>(k)};
  }
  return best;
}

struct TileMap {
  std::size_t windows = 0, across = 0;
  std::vector<Tile> tiles;
};

std::size_t windows_in(std::size_t rows) { return rows < window ? 0 : (rows - window) / hop + 1; }

// `logs`: log light. The common share of a tile bounds that of any tone in it, and costs a few sums; only where it
// reaches the threshold are tones looked at.
TileMap tile_map(const Reduced& logs, double threshold) {
  const std::size_t groups = std::min(most_groups, logs.groups);
  TileMap map{windows_in(logs.rows), logs.groups - groups + 1, {}};
  map.tiles.resize(map.windows * map.across);
  Moments own(logs.groups), common(map.across);
  std::vector<float> swing(logs.groups), together(map.across);
  for (std::size_t w = 0; w < map.windows; ++w) {
    const float* first = &logs.light[w * hop * logs.groups];
    own.clear();
    common.clear();
    for (std::size_t n = 0; n < window; ++n) {
      const float* row = first + n * logs.groups;
      for (std::size_t g = 0; g < logs.groups; ++g) swing[g] = row[g] - first[g];  // keeps float sums of squares exact
      const float* s = swing.data();
      if (groups == 3)
        for (std::size_t g = 0; g < map.across; ++g) together[g] = s[g] + s[g + 1] + s[g + 2];
      else
        for (std::size_t g = 0; g < map.across; ++g) together[g] = groups == 2 ? s[g] + s[g + 1] : s[g];
      own.add(s, waves().slope[n]);
      common.add(together.data(), waves().slope[n]);
    }
    for (std::size_t g = 0; g < map.across; ++g) {
      float energy = 0;
      for (std::size_t k = 0; k < groups; ++k) energy += own.energy(g + k);
      const auto count = static_cast<float>(groups);
      if (!(energy > least_power * window * count) || common.energy(g) < static_cast<float>(threshold) * count * energy)
        continue;
      const Tone tone = strongest_tone(first + g, logs.groups, groups);
      const double share = tone.energy / static_cast<double>(count * energy);
      if (share >= threshold) map.tiles[w * map.across + g] = {static_cast<float>(std::min(share, 0.9999)), tone.wave};
    }
  }
  return map;
}

bool alike(std::uint8_t a, std::uint8_t b) { return std::abs(cycles[a] - cycles[b]) <= 1; }

// Tiles that touch, corners included, and agree in frequency.
void add_suspects(const TileMap& map, const Reduced& scale, std::vector<Suspect>& suspects) {
  std::vector<std::uint8_t> seen(map.tiles.size());
  std::vector<std::size_t> open;
  const std::size_t groups = std::min(most_groups, scale.groups);
  for (std::size_t start = 0; start < map.tiles.size(); ++start) {
    if (seen[start] || map.tiles[start].share == 0) continue;
    std::size_t top = map.windows, bottom = 0, left = map.across, right = 0;
    Tile best;
    double evidence = 0;
    open.assign(1, start);
    seen[start] = 1;
    while (!open.empty()) {
      const std::size_t at = open.back(), w = at / map.across, g = at % map.across;
      open.pop_back();
      const Tile tile = map.tiles[at];
      if (tile.share > best.share) best = tile;
      evidence -= std::log1p(-static_cast<double>(tile.share));
      top = std::min(top, w), bottom = std::max(bottom, w), left = std::min(left, g), right = std::max(right, g);
      for (std::size_t v = w - (w > 0); v <= std::min(w + 1, map.windows - 1); ++v)
        for (std::size_t h = g - (g > 0); h <= std::min(g + 1, map.across - 1); ++h) {
          const std::size_t next = v * map.across + h;
          if (seen[next] || map.tiles[next].share == 0 || !alike(map.tiles[next].wave, tile.wave)) continue;
          seen[next] = 1;
          open.push_back(next);
        }
    }
    suspects.push_back({left * scale.column_step, top * hop * scale.row_step,
                        (right - left + groups) * scale.column_step, ((bottom - top) * hop + window) * scale.row_step,
                        cycles[best.wave] / static_cast<double>(window * scale.row_step),
                        static_cast<double>(best.share), evidence});
  }
}

// The share that white noise passes `false_alarms` times in so many tiles.
double share_threshold(std::size_t tiles, std::size_t groups, double false_alarms) {
  const double tests = static_cast<double>(std::max<std::size_t>(tiles, 1) * cycles.size());
  const double half_freedom = (static_cast<double>(groups * (window - 2)) - 2) / 2;
  return std::max(least_share, 1 - std::pow(std::min(false_alarms / tests, 1.0), 1 / half_freedom));
}

std::vector<Reduced> scales_of(Reduced finest) {
  std::vector<Reduced> scales;
  const bool wide = finest.groups >= most_groups * wide_factor;
  if (wide) scales.push_back(widened(finest));
  scales.push_back(std::move(finest));
  while (scales.back().rows / 2 >= window) {
    scales.push_back(half(scales.back()));
    if (scales.back().groups >= most_groups * wide_factor) {
      Reduced narrow = std::move(scales.back());
      scales.back() = widened(narrow);
      scales.push_back(std::move(narrow));
    }
  }
  return scales;
}

}  // namespace

double logarithm_floor(const AnyFramesView& frames, const ToneCurve& curve) {
  return std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        if (std::is_integral_v<T> || curve.white_level != 0)
          return (white_level(curve, sample_maximum<T>()) - curve.dark_level) / 64;
        double top = 0;  // floating-point samples of no stated range
        for (std::size_t f = 0; f < view.frames; ++f)
          for (std::size_t n = 0; n < view.rows; ++n)
            for (std::size_t c = 0; c < view.columns; ++c)
              top = std::max(top, static_cast<double>(view(f, n, c)) - curve.dark_level);
        return top > 0 ? top / 64 : 1;
      },
      frames);
}

std::vector<Suspect> screen_sources(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                                    double false_alarms) {
  const auto floor = static_cast<float>(logarithm_floor(frames, curve));
  auto scales =
      scales_of(std::visit([&](const auto& view) { return reduced(view.frame(frame), curve.dark_level); }, frames));
  std::size_t tiles = 0;
  for (const Reduced& scale : scales) tiles += windows_in(scale.rows) * scale.groups;
  std::vector<Suspect> suspects;
  for (Reduced& scale : scales) {
    take_logarithm(scale, floor);
    const double threshold = share_threshold(tiles, std::min(most_groups, scale.groups), false_alarms);
    add_suspects(tile_map(scale, threshold), scale, suspects);
  }
  std::ranges::stable_sort(suspects, std::greater{}, &Suspect::evidence);
  return suspects;
}

}  // namespace ocisac
