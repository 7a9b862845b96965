#include "cleaning/cleaned_picture.hpp"

#include <cmath>

#include "core/check_interrupt.hpp"

namespace ocisac {

double pair_misfit(const BandedPicture& picture, std::size_t lag) {
  check_interrupt();
  const double texture = kRowTextures.back();
  const std::size_t apart = lag * picture.columns, pixels = picture.rows * picture.columns;
  double sum = 0, pairs = 0;
  for (std::size_t frame = 0; frame < picture.frames; ++frame)
    for (std::size_t i = frame * pixels, j = i + apart; j < (frame + 1) * pixels; ++i, ++j) {
      const double difference = picture.light[j] - picture.light[i], mean = 0.5 * (picture.light[j] + picture.light[i]);
      const double spread = difference * difference + picture.variance[j] + picture.variance[i];
      if (!(mean > 0) || !std::isfinite(spread)) continue;
      sum += std::log(texture * texture * mean * mean + spread) - 2 * std::log(mean);
      ++pairs;
    }
  return pairs > 0 ? sum / pairs : 0;
}

double row_misfit(const BandedPicture& picture, std::span<const double> row_light, std::span<const double> share,
                  std::size_t lag) {
  check(picture, row_light);
  const std::size_t columns = picture.columns, pixels = picture.rows * columns;
  require(share.size() == 1 || share.size() == columns || share.size() == pixels, "share", share.size(),
          "one value, or one a column or pixel");
  require(lag > 0, "lag", lag, "1 or more");
  const auto share_of = [&](std::size_t row, std::size_t column) {
    return share[(row * columns + column) % share.size()];
  };
  const Blocks cleaned = without_light(picture, row_light, share_of);
  return pair_misfit({cleaned.light, cleaned.variance, picture.frames, picture.rows, columns}, lag);
}

}  // namespace ocisac
