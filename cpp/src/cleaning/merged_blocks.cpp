#include "cleaning/merged_blocks.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "cleaning/block_shares.hpp"
#include "core/check_interrupt.hpp"
#include "core/statistics.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

Blocks merged(const Blocks& from, std::size_t height, std::size_t width) {
  if (height == 1 && width == 1) return from;
  Blocks to{blocks_of(from.rows, height), blocks_of(from.columns, width), {}, {}};
  to.light.resize(to.rows * to.columns);
  to.variance.resize(to.light.size());
  std::vector<double> known(to.light.size());
  for (std::size_t n = 0; n < from.rows; ++n) {
    check_interrupt();
    for (std::size_t block = 0; block < to.columns; ++block) {
      const std::size_t at = n / height * to.columns + block, first = n * from.columns + block * width;
      const std::size_t end = std::min(first + width, (n + 1) * from.columns);
      for (std::size_t i = first; i < end; ++i) {
        const bool is_known = std::isfinite(from.variance[i]);
        known[at] += is_known ? 1 : 0;
        to.light[at] += is_known ? from.light[i] : 0;
        to.variance[at] += is_known ? from.variance[i] : 0;
      }
    }
  }
  for (std::size_t i = 0; i < known.size(); ++i) {
    to.light[i] /= std::max(known[i], 1.0);
    to.variance[i] = known[i] > 0 ? to.variance[i] / (known[i] * known[i]) : std::numeric_limits<double>::infinity();
  }
  return to;
}

}  // namespace

Blocks copy_of(const BandedPicture& picture) {
  return {picture.frames * picture.rows,
          picture.columns,
          {picture.light.begin(), picture.light.end()},
          {picture.variance.begin(), picture.variance.end()}};
}

Blocks sum_of(std::span<const BandedPicture> colours) {
  Blocks sum = copy_of(colours.front());
  for (const BandedPicture& colour : colours.subspan(1)) {
    require(colour.light.size() == sum.light.size(), "colours", colour.light.size(), "pictures of one shape");
    for (std::size_t i = 0; i < sum.light.size(); ++i) {
      sum.light[i] += colour.light[i];
      sum.variance[i] += colour.variance[i];
    }
  }
  return sum;
}

Blocks merged_down(const Blocks& from, std::size_t count) { return merged(from, count, 1); }

Blocks merged_along(const Blocks& from, std::size_t count) { return merged(from, 1, count); }

std::vector<double> means_of_rows(std::span<const double> row_light, std::size_t rows, std::size_t count) {
  std::vector<double> means;
  for (std::size_t frame = 0; frame < row_light.size(); frame += rows)
    for (std::size_t first = 0; first < rows; first += count)
      means.push_back(mean_of(row_light.subspan(frame + first, std::min(count, rows - first))));
  return means;
}

}  // namespace ocisac
