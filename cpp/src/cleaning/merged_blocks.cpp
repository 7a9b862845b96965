#include "cleaning/merged_blocks.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "cleaning/block_shares.hpp"
#include "core/check_interrupt.hpp"
#include "core/statistics.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

Blocks block_means(const BandedPicture& picture, std::size_t height, std::size_t width) {
  const std::size_t rows = picture.frames * picture.rows, columns = picture.columns;
  if (height == 1 && width == 1)
    return {rows,
            columns,
            {picture.light.begin(), picture.light.end()},
            {picture.variance.begin(), picture.variance.end()}};
  Blocks to{blocks_of(rows, height), blocks_of(columns, width), {}, {}};
  to.light.resize(to.rows * to.columns);
  to.variance.resize(to.light.size());
  std::vector<double> known(to.light.size());
  for (std::size_t n = 0; n < rows; ++n) {
    check_interrupt();
    for (std::size_t block = 0; block < to.columns; ++block) {
      const std::size_t at = n / height * to.columns + block, first = n * columns + block * width;
      const std::size_t end = std::min(first + width, (n + 1) * columns);
      for (std::size_t i = first; i < end; ++i) {
        const bool is_known = std::isfinite(picture.variance[i]);
        known[at] += is_known ? 1 : 0;
        to.light[at] += is_known ? picture.light[i] : 0;
        to.variance[at] += is_known ? picture.variance[i] : 0;
      }
    }
  }
  for (std::size_t i = 0; i < known.size(); ++i) {
    to.light[i] /= std::max(known[i], 1.0);
    to.variance[i] = known[i] > 0 ? to.variance[i] / (known[i] * known[i]) : std::numeric_limits<double>::infinity();
  }
  return to;
}

Blocks sum_of(std::span<const BandedPicture> colours) {
  Blocks sum = block_means(colours.front(), 1, 1);
  for (const BandedPicture& colour : colours.subspan(1)) {
    require(colour.light.size() == sum.light.size(), "colours", colour.light.size(), "pictures of one shape");
    for (std::size_t i = 0; i < sum.light.size(); ++i) {
      sum.light[i] += colour.light[i];
      sum.variance[i] += colour.variance[i];
    }
  }
  return sum;
}

std::vector<double> means_of_rows(std::span<const double> row_light, std::size_t rows, std::size_t count) {
  std::vector<double> means;
  for (std::size_t frame = 0; frame < row_light.size(); frame += rows)
    for (std::size_t first = 0; first < rows; first += count)
      means.push_back(mean_of(row_light.subspan(frame + first, std::min(count, rows - first))));
  return means;
}

}  // namespace ocisac
