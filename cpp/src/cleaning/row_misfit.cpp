#include "cleaning/row_misfit.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "cleaning/cleaned_picture.hpp"
#include "cleaning/pair_misfit.hpp"
#include "core/check_interrupt.hpp"

namespace ocisac {

namespace {

constexpr double texture = 0.05;    // relative difference of neighbours that texture causes
constexpr double far_apart = 1e60;  // a misfit above which its logarithm is taken alone

}  // namespace

void add_misfit(std::span<const double> light, std::span<const double> variance, std::size_t lag,
                std::span<PairMisfit> of_columns) {
  check_interrupt();
  const std::size_t columns = of_columns.size();
  std::vector<LogSum> sums(columns);
  for (std::size_t i = 0, j = lag * columns; j < light.size(); i += columns, j += columns)
    for (std::size_t k = 0; k < columns; ++k) {
      const double difference = light[j + k] - light[i + k], mean = 0.5 * (light[j + k] + light[i + k]);
      const double spread = difference * difference + variance[j + k] + variance[i + k];
      if (!(mean > 0) || !std::isfinite(spread)) continue;
      const double misfit = texture * texture + spread / (mean * mean);
      ++of_columns[k].pairs;
      if (misfit < far_apart)
        sums[k].add(misfit);
      else  // mean² may vanish
        of_columns[k].sum += std::log(spread) - 2 * std::log(mean);
    }
  for (std::size_t k = 0; k < columns; ++k) of_columns[k].sum += sums[k].value();
}

double row_misfit(const BandedPicture& picture, std::span<const double> row_light, std::span<const double> share,
                  std::size_t lag) {
  check(picture, row_light);
  const std::size_t rows = picture.rows, columns = picture.columns, pixels = rows * columns;
  require(share.size() == 1 || share.size() == columns || share.size() == pixels, "share", share.size(),
          "one value, or one a column or pixel");
  require(lag > 0, "lag", lag, "1 or more");
  const std::size_t down = share.size() == pixels ? columns : 0, across = share.size() == 1 ? 0 : 1;
  std::vector<double> light(pixels), variance(pixels);
  std::vector<PairMisfit> of_columns(columns);
  for (std::size_t frame = 0; frame < picture.frames; ++frame) {
    for (std::size_t n = 0; n < rows; ++n) {
      const double change = row_light[frame * rows + n] - 1;
      for (std::size_t k = 0; k < columns; ++k) {
        const std::size_t at = n * columns + k;
        const double left = std::max(1 + share[n * down + k * across] * change, min_judged_light);
        light[at] = picture.light[frame * pixels + at] / left;
        variance[at] = picture.variance[frame * pixels + at] / (left * left);
      }
    }
    add_misfit(light, variance, lag, of_columns);
  }
  PairMisfit all;
  for (const PairMisfit& one : of_columns) all += one;
  return all.mean();
}

}  // namespace ocisac
