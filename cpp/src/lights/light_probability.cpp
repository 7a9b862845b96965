#include "lights/light_probability.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "lights/light_model.hpp"

namespace ocisac {

namespace {

constexpr double kRounding = 0.01;  // of shares near 0
constexpr double kWide = 3;         // ln of cycles: few of the fitted lights are wider

double log_share(double share) { return std::log(std::max(share, 0.0) + kRounding); }

double log_of(std::size_t count) { return std::log(static_cast<double>(std::max<std::size_t>(count, 1))); }

double squared(double x) { return x * x; }

template <class Terms>
double logistic(double intercept, const Terms& weights, const Terms& terms) {
  return 1 / (1 + std::exp(-std::inner_product(terms.begin(), terms.end(), weights.begin(), intercept)));
}

}  // namespace

ToneTerms terms_of(const RefinedLight& light, std::size_t suspects, double others) {
  const double height = std::log(light.frequency * static_cast<double>(light.box.height));  // in cycles
  const double width = std::log(light.frequency * static_cast<double>(light.box.width));
  const double aperiodic = log_share(1 - light.periodic);
  return {height,
          squared(std::min(width, kWide)),
          std::abs(height - width),
          aperiodic,
          squared(aperiodic),
          squared(log_share(1 - light.common)),
          log_share(std::min(light.depth, 1.0)),
          light.contour,
          std::log1p(others),
          squared(log_of(suspects)),
          squared(log_share(light.across)),
          squared(light.uneven * std::min(light.texture, 1.0))};
}

DataTerms terms_of(const DataLight& data, std::size_t suspects) {
  const RefinedLight& light = data.light;
  return {log_of(suspects),
          std::log(static_cast<double>(data.edges)),
          squared(std::log1p(data.clock)),
          std::log(light.frequency * static_cast<double>(light.box.width)),
          squared(log_share(1 - data.periodic)),
          log_share(light.texture)};
}

double probability_of(const ToneTerms& terms) { return logistic(kToneIntercept, kToneWeights, terms); }

double probability_of(const DataTerms& terms) { return logistic(kDataIntercept, kDataWeights, terms); }

double probability_for(double false_alarms) { return kRequiredOdds / (kRequiredOdds + false_alarms); }

}  // namespace ocisac
