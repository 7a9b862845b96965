#include "columns/contrast_slope.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numeric>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "ocisac/camera/linear_light.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kApart = 2;       // columns: neighbours share light by optics and interpolation
constexpr std::size_t kMaxPairs = 256;  // of columns, evenly spaced
constexpr std::size_t kGroups = 8;      // of rows; the least number of pairs
constexpr double kAlike = 0.35;         // (a − b)/(a + b) of the depths of a pair
constexpr double kFloor = 1.0 / 64;     // of the brightest row

// Light of pairs of columns that do not saturate: (rows × pairs).
struct PairedColumns {
  std::vector<double> first, second;
  std::size_t pairs = 0;
};

PairedColumns paired_columns(const AnyFramesView& frames, std::size_t frame, const Region& box,
                             const ToneCurve& curve) {
  const double saturation = saturation_level(frames, curve);
  return std::visit(
      [&](const auto& view) {
        const auto value = [&](std::size_t n, std::size_t column) {
          return static_cast<double>(view(frame, box.y + n, box.x + column));
        };
        std::vector<std::size_t> pairs;
        const std::size_t all = box.width > kApart ? box.width - kApart : 0, step = 1 + all / kMaxPairs;
        for (std::size_t c = 0; c < all; c += step) {
          bool clear = true;
          for (std::size_t n = 0; n < box.height && clear; ++n)
            clear = !(value(n, c) >= saturation || value(n, c + kApart) >= saturation);
          if (clear) pairs.push_back(c);
        }
        PairedColumns rows{{}, {}, pairs.size()};
        for (std::size_t n = 0; n < box.height; ++n)
          for (const std::size_t c : pairs) {
            rows.first.push_back(value(n, c) - curve.dark_level);
            rows.second.push_back(value(n, c + kApart) - curve.dark_level);
          }
        return rows;
      },
      frames);
}

double sum_of(std::span<const double> values) { return std::accumulate(values.begin(), values.end(), 0.0); }

// Depth of the course in each column of (rows × columns), relative to the column's mean and in the course's unit.
std::vector<double> depths(const std::vector<double>& columns, std::size_t count, const std::vector<double>& course) {
  const double mean = mean_of(course);
  std::vector<double> depth(count), sums(count);
  for (std::size_t i = 0; i < columns.size(); ++i) {
    depth[i % count] += columns[i] * (course[i / count] - mean);
    sums[i % count] += columns[i];
  }
  for (std::size_t k = 0; k < count; ++k) depth[k] = sums[k] > 0 ? depth[k] / sums[k] : 0;
  return depth;
}

// Pairs of columns that show the same light in the same depth; beside a lamp's edge they do not.
std::vector<std::size_t> alike_pairs(const PairedColumns& columns, const std::vector<double>& course) {
  const auto first = depths(columns.first, columns.pairs, course),
             second = depths(columns.second, columns.pairs, course);
  double largest = 0;
  for (const double depth : first) largest = std::max(largest, depth);
  std::vector<std::size_t> alike;
  for (std::size_t k = 0; k < columns.pairs; ++k)
    if (std::min(first[k], second[k]) > kMostly * largest &&
        std::abs(first[k] - second[k]) <= kAlike * (first[k] + second[k]))
      alike.push_back(k);
  return alike;
}

// Relative squared contrast between the columns, and log light, of each two adjacent rows. False where the rows have no
// light or no contrast.
bool add_contrast(const PairedColumns& columns, const std::vector<std::size_t>& pairs, std::vector<double>& contrast,
                  std::vector<double>& light) {
  std::vector<double> means(columns.first.size() / columns.pairs);
  for (std::size_t n = 0; n < means.size(); ++n)
    for (const std::size_t k : pairs)
      means[n] += (columns.first[n * columns.pairs + k] + columns.second[n * columns.pairs + k]) / 2;
  const double floor = kFloor * *std::ranges::max_element(means);
  if (!(floor > 0)) return false;
  for (std::size_t n = 0; n + 1 < means.size(); ++n) {
    double product = 0;
    for (const std::size_t k : pairs) {
      const std::size_t i = n * columns.pairs + k, next = i + columns.pairs;
      product += (columns.second[i] - columns.first[i]) * (columns.second[next] - columns.first[next]);
    }
    const double both = (std::max(means[n], 0.0) + floor) * (std::max(means[n + 1], 0.0) + floor);
    contrast.push_back(product / both);
    light.push_back(std::log(both) / 2);
  }
  const double mean = mean_of(contrast);
  for (double& value : contrast) value /= mean;
  return mean > 0;
}

// Σ contrast·course / Σ light·course, and its jackknife over groups of rows, in each of which the course has no line.
ContrastSlope slope_of(const std::vector<double>& contrast, const std::vector<double>& light,
                       const std::vector<double>& course) {
  std::array<double, kGroups> products{}, lights{};
  const std::size_t count = contrast.size();
  std::vector<double> along(count);
  std::transform(course.begin(), course.end() - 1, course.begin() + 1, along.begin(), std::plus{});
  for (std::size_t group = 0; group < kGroups; ++group) {
    const std::size_t begin = group * count / kGroups, end = (group + 1) * count / kGroups;
    remove_line(std::span(along).subspan(begin, end - begin));
    for (std::size_t n = begin; n < end; ++n) {
      products[group] += contrast[n] * along[n];
      lights[group] += light[n] * along[n];
    }
  }
  const double product = sum_of(products), all_light = sum_of(lights);
  ContrastSlope found{product / all_light, 0};
  double scatter = 0;
  for (std::size_t group = 0; group < kGroups; ++group)
    scatter += std::pow((product - products[group]) / (all_light - lights[group]) - found.slope, 2);
  found.std = std::sqrt(scatter * (kGroups - 1) / kGroups);
  return std::isfinite(found.std) ? found : ContrastSlope{};
}

}  // namespace

bool ContrastSlope::is_of_texture() const {
  return -2 - slope > kSure * std;  // more than a veil's
}

ContrastSlope contrast_slope(const AnyFramesView& frames, std::size_t frame, const Region& box, const ToneCurve& curve,
                             std::span<const double> course) {
  const PairedColumns columns = paired_columns(frames, frame, box, curve);
  if (columns.pairs < kGroups || box.height < 4 * kGroups) return {};
  std::vector<double> own(course.begin(), course.end());
  for (std::size_t n = own.size(); n < box.height; ++n) {
    own.push_back(sum_of(std::span(columns.first).subspan(n * columns.pairs, columns.pairs)));
  }
  const std::vector<std::size_t> pairs = alike_pairs(columns, own);
  if (pairs.size() < kGroups) return {};
  std::vector<double> contrast, light;
  return add_contrast(columns, pairs, contrast, light) ? slope_of(contrast, light, own) : ContrastSlope{};
}

}  // namespace ocisac
