#include "cleaning/row_misfit.hpp"

#include <cmath>
#include <vector>

#include "cleaning/cleaned_picture.hpp"
#include "core/check_interrupt.hpp"

namespace ocisac {

namespace {

constexpr double kLarge = 1e100;  // products of misfits up to which take one logarithm together

}  // namespace

double pair_misfit(const BandedPicture& picture, std::size_t lag) {
  check_interrupt();
  const double texture = kRowTextures.back();
  const std::size_t apart = lag * picture.columns, pixels = picture.rows * picture.columns;
  double sum = 0, product = 1, pairs = 0;
  for (std::size_t frame = 0; frame < picture.frames; ++frame)
    for (std::size_t i = frame * pixels, j = i + apart; j < (frame + 1) * pixels; ++i, ++j) {
      const double difference = picture.light[j] - picture.light[i], mean = 0.5 * (picture.light[j] + picture.light[i]);
      const double spread = difference * difference + picture.variance[j] + picture.variance[i];
      if (!(mean > 0) || !std::isfinite(spread)) continue;
      const double misfit = texture * texture + spread / (mean * mean);
      ++pairs;
      if (!(misfit < kLarge)) {  // mean² may vanish
        sum += std::log(spread) - 2 * std::log(mean);
        continue;
      }
      product *= misfit;
      if (product < kLarge && product > 1 / kLarge) continue;
      sum += std::log(product);
      product = 1;
    }
  return pairs > 0 ? (sum + std::log(product)) / pairs : 0;
}

double row_misfit(const BandedPicture& picture, std::span<const double> row_light, std::span<const double> share,
                  std::size_t lag) {
  check(picture, row_light);
  const std::size_t columns = picture.columns, pixels = picture.rows * columns;
  require(share.size() == 1 || share.size() == columns || share.size() == pixels, "share", share.size(),
          "one value, or one a column or pixel");
  require(lag > 0, "lag", lag, "1 or more");
  std::vector<double> light(picture.light.size()), variance(light.size());
  for (std::size_t i = 0; i < light.size(); ++i) {
    const double left = light_left(share[i % share.size()], row_light[i / columns] - 1);
    light[i] = picture.light[i] / left;
    variance[i] = picture.variance[i] / (left * left);
  }
  return pair_misfit({light, variance, picture.frames, picture.rows, columns}, lag);
}

}  // namespace ocisac
