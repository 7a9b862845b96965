#include "cleaning/merged_blocks.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "cleaning/block_shares.hpp"
#include "core/check_interrupt.hpp"
#include "core/statistics.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

Blocks block_means(std::span<const BandedPicture> colours, std::size_t height, std::size_t width) {
  const std::size_t rows = colours.front().frames * colours.front().rows, columns = colours.front().columns;
  for (const BandedPicture& colour : colours)
    require(colour.light.size() == rows * columns, "colours", colour.light.size(), "pictures of one shape");
  Blocks to{blocks_of(rows, height), blocks_of(columns, width), {}, {}};
  to.light.resize(to.rows * to.columns);
  to.variance.resize(to.light.size());
  std::vector<double> known(to.light.size()), light(columns), variance(columns);
  for (std::size_t n = 0; n < rows; ++n) {
    check_interrupt();
    std::copy_n(&colours.front().light[n * columns], columns, light.begin());
    std::copy_n(&colours.front().variance[n * columns], columns, variance.begin());
    for (const BandedPicture& colour : colours.subspan(1))
      for (std::size_t i = 0; i < columns; ++i) {
        light[i] += colour.light[n * columns + i];
        variance[i] += colour.variance[n * columns + i];
      }
    for (std::size_t block = 0, at = n / height * to.columns; block < to.columns; ++block, ++at) {
      double count = known[at], sum = to.light[at], spread = to.variance[at];
      for (std::size_t i = block * width; i < std::min((block + 1) * width, columns); ++i) {
        const bool is_known = std::isfinite(variance[i]);
        count += is_known ? 1 : 0;
        sum += is_known ? light[i] : 0;
        spread += is_known ? variance[i] : 0;
      }
      known[at] = count;
      to.light[at] = sum;
      to.variance[at] = spread;
    }
  }
  for (std::size_t i = 0; i < known.size(); ++i) {
    to.light[i] /= std::max(known[i], 1.0);
    to.variance[i] = known[i] > 0 ? to.variance[i] / (known[i] * known[i]) : std::numeric_limits<double>::infinity();
  }
  return to;
}

Blocks block_means(const BandedPicture& picture, std::size_t height, std::size_t width) {
  if (height > 1 || width > 1) return block_means(std::span(&picture, 1), height, width);
  return {picture.frames * picture.rows,
          picture.columns,
          {picture.light.begin(), picture.light.end()},
          {picture.variance.begin(), picture.variance.end()}};
}

std::vector<double> means_of_rows(std::span<const double> row_light, std::size_t rows, std::size_t count) {
  std::vector<double> means;
  for (std::size_t frame = 0; frame < row_light.size(); frame += rows)
    for (std::size_t first = 0; first < rows; first += count)
      means.push_back(mean_of(row_light.subspan(frame + first, std::min(count, rows - first))));
  return means;
}

}  // namespace ocisac
