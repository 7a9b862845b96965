#include "cleaning/colour_shares.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "cleaning/block_shares.hpp"
#include "cleaning/quantile.hpp"
#include "cleaning/row_misfit.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

constexpr std::size_t most_tried_columns = 256;  // of a picture, in its middle, for the gain by chance
constexpr double clear_gain = 0.1;               // of the log-likelihood of a pair of pixels; by chance at most 0.03
constexpr double gain_over_chance = 2;  // pictures under an even light have 0.8 to 1.6, lights that cost 1 dB with one
                                        // share 2 and more
constexpr int steps = 40;
constexpr double reach = 0.1;  // of a share from the median of those of the pixels

double left_of(double share, double row_light) { return std::max(1 + share * (row_light - 1), min_judged_light); }

// Copied columns of a colour, with the row light that they are compared under.
struct Part {
  BandedPicture shape;
  Values light, variance, row_light;

  [[nodiscard]] BandedColour colour() const {
    return {{light, variance, shape.frames, shape.rows, shape.columns}, row_light};
  }
};

// Columns first, first + every, ...; at most `count`.
Part part_of(const BandedColour& colour, std::size_t first, std::size_t every, std::size_t count) {
  const BandedPicture& picture = colour.picture;
  const std::size_t columns = std::min(count, blocks_of(picture.columns - first, every));
  Part part{
      {{}, {}, picture.frames, picture.rows, columns}, {}, {}, {colour.row_light.begin(), colour.row_light.end()}};
  for (std::size_t row = 0; row < picture.frames * picture.rows; ++row)
    for (std::size_t k = 0; k < columns; ++k) {
      const std::size_t at = row * picture.columns + first + k * every;
      part.light.push_back(picture.light[at]);
      part.variance.push_back(picture.variance[at]);
    }
  return part;
}

double misfit_of(const BandedColour& colour, std::span<const double> share) {
  const std::size_t lag = comparison_lag(colour.row_light, colour.picture.rows);
  return row_misfit(colour.picture, colour.row_light, share, lag);
}

// The likeliest share of all pixels, near the median of their own ones.
double one_share(const BandedColour& colour, std::span<const double> share) {
  const double middle = quantile(share, 0.5);
  const double low = std::max(middle - reach, 0.0), high = std::min(middle + reach, 1.0);
  const std::size_t every = std::max<std::size_t>(1, colour.picture.columns / most_tried_columns);
  const Part part = part_of(colour, 0, every, colour.picture.columns);
  double best = low, least = HUGE_VAL;
  for (int k = 0; k <= steps; ++k) {
    const double tried = low + (high - low) / steps * k;
    const double misfit = misfit_of(part.colour(), {&tried, 1});
    if (!(misfit < least)) continue;
    best = tried;
    least = misfit;
  }
  return best;
}

// Increase of the likelihood by shares of each pixel over one for all.
double gain_of(const BandedColour& colour, std::span<const double> share, double one) {
  return misfit_of(colour, {&one, 1}) - misfit_of(colour, share);
}

// The move, a quarter to half of the frame, at which the row light correlates least with itself.
std::size_t move_unlike(std::span<const double> rows) {
  const std::size_t count = rows.size();
  const double mean = std::accumulate(rows.begin(), rows.end(), 0.0) / static_cast<double>(count);
  std::size_t best = count / 4;
  double least = HUGE_VAL;
  for (std::size_t move = count / 4; move <= count / 2; ++move) {
    double product = 0;
    for (std::size_t n = 0; n < count; ++n) product += (rows[n] - mean) * (rows[(n + count - move) % count] - mean);
    if (!(std::abs(product) < least)) continue;
    best = move;
    least = std::abs(product);
  }
  return best;
}

// The row light (frames × rows), each frame's moved by its own way in circles.
Values moved_rows(std::span<const double> row_light, std::size_t rows, bool up) {
  Values moved;
  for (std::size_t first = 0; first < row_light.size(); first += rows) {
    const std::span<const double> frame = row_light.subspan(first, rows);
    const std::size_t move = move_unlike(frame);
    for (std::size_t n = 0; n < rows; ++n) moved.push_back(frame[(n + (up ? move : rows - move)) % rows]);
  }
  return moved;
}

// Puts an even light of share `one` and of the course `moved` onto the cleaned picture; `share`: (rows × columns) of
// the light that it takes away.
Part under_even_light(Part part, std::span<const double> share, double one, Values moved) {
  const std::size_t pixels = part.shape.rows * part.shape.columns;
  for (std::size_t i = 0; i < part.light.size(); ++i) {
    const std::size_t row = i / part.shape.columns;
    const double change = left_of(one, moved[row]) / left_of(share[i % pixels], part.row_light[row]);
    part.light[i] *= change;
    part.variance[i] *= change * change;
  }
  part.row_light = std::move(moved);
  return part;
}

// The larger gain of two places for the light: moves by m and N - m rows correlate alike with the light itself.
double gain_by_chance(const BandedColour& colour, std::span<const double> share, double one) {
  const std::size_t columns = colour.picture.columns, rows = colour.picture.rows;
  const std::size_t first = columns > most_tried_columns ? (columns - most_tried_columns) / 2 : 0;
  const Part middle = part_of(colour, first, 1, most_tried_columns);
  Values own;
  for (std::size_t n = 0; n < rows; ++n)
    for (std::size_t k = 0; k < middle.shape.columns; ++k) own.push_back(share[n * columns + first + k]);
  double most = -HUGE_VAL;
  for (const bool up : {false, true}) {
    const Part even = under_even_light(middle, own, one, moved_rows(colour.row_light, rows, up));
    const Values found = light_share(even.colour().picture, even.row_light);
    most = std::max(most, gain_of(even.colour(), found, one_share(even.colour(), found)));
  }
  return most;
}

}  // namespace

std::vector<std::vector<double>> colour_shares(std::span<const BandedColour> colours) {
  std::vector<Values> shares;
  Values one;
  double gain = 0;
  for (const BandedColour& colour : colours) {
    shares.push_back(light_share(colour.picture, colour.row_light));
    one.push_back(one_share(colour, shares.back()));
    gain += gain_of(colour, shares.back(), one.back());
  }
  if (gain >= clear_gain * static_cast<double>(colours.size())) return shares;
  double by_chance = 0;
  for (std::size_t k = 0; k < colours.size(); ++k) by_chance += gain_by_chance(colours[k], shares[k], one[k]);
  if (gain < gain_over_chance * by_chance)
    for (std::size_t k = 0; k < colours.size(); ++k) std::fill(shares[k].begin(), shares[k].end(), one[k]);
  return shares;
}

}  // namespace ocisac
