#include "cleaning/colour_shares.hpp"

#include <algorithm>

#include "cleaning/row_misfit.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

// Increase of the log-likelihood of a pair of pixels: pictures under an even light have at most 0.03.
constexpr double gain_by_chance = 0.05;

double misfit_of(const BandedColour& colour, std::span<const double> share) {
  const std::size_t lag = comparison_lag(colour.row_light, colour.picture.rows);
  return row_misfit(colour.picture, colour.row_light, share, lag);
}

// Increase of the likelihood by shares of each pixel over one for all.
double gain_of(const BandedColour& colour, std::span<const double> share, double one) {
  return misfit_of(colour, {&one, 1}) - misfit_of(colour, share);
}

}  // namespace

std::vector<std::vector<double>> colour_shares(std::span<const BandedColour> colours) {
  std::vector<Values> shares;
  Values one;
  double gain = 0;
  for (const BandedColour& colour : colours) {
    shares.push_back(light_share(colour.picture, colour.row_light));
    one.push_back(even_share(colour.picture, colour.row_light));
    gain += gain_of(colour, shares.back(), one.back());
  }
  if (gain < gain_by_chance * static_cast<double>(colours.size()))
    for (std::size_t k = 0; k < colours.size(); ++k) std::fill(shares[k].begin(), shares[k].end(), one[k]);
  return shares;
}

}  // namespace ocisac
