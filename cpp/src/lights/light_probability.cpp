#include "lights/light_probability.hpp"

#include <algorithm>
#include <cmath>

namespace ocisac {

namespace {

constexpr double rounding = 0.01;       // of shares near 0
constexpr double clear_texture = 0.25;  // below it noise, which log light shows in dark rows, makes texture uneven

constexpr double intercept = -17.504;
constexpr ToneFeatures linear{-0.887, 6.944, 3.403, -1.705, -5.656, -3.142, -0.846, 3.501, 0.806};
constexpr ToneFeatures square{0, -1.05, -0.57, -0.273, 6.926, -0.555, -0.009, -1.29, 1.144};
constexpr double data_intercept = -6.959;
constexpr DataFeatures data_linear{-1, 0.662, 0.131, 1.561, -1.526, 0.215, -9.803};
constexpr DataFeatures data_square{0, 0.092, 0.288, 0.15, 0.148, 0.019, -6.611};

double log_share(double share) { return std::log(std::max(share, 0.0) + rounding); }

template <class Features>
double logistic(double sum, const Features& linear_terms, const Features& square_terms, const Features& features) {
  for (std::size_t i = 0; i < features.size(); ++i)
    sum += (linear_terms[i] + square_terms[i] * features[i]) * features[i];
  return 1 / (1 + std::exp(-sum));
}

}  // namespace

ToneFeatures features_of(const RefinedLight& light, std::size_t suspects) {
  const double cycles = light.frequency * static_cast<double>(light.box.height);
  return {std::log(static_cast<double>(std::max<std::size_t>(suspects, 1))),
          std::log(cycles),
          std::log(light.frequency * static_cast<double>(light.box.width)),
          log_share(light.texture),
          light.uneven * std::min(light.texture / clear_texture, 1.0),
          log_share(1 - light.periodic),
          log_share(1 - light.common),
          std::min(light.depth, 1.0),
          light.contour};
}

DataFeatures features_of(const DataLight& data, std::size_t suspects) {
  const RefinedLight& light = data.light;
  return {std::log(static_cast<double>(std::max<std::size_t>(suspects, 1))),
          std::log(static_cast<double>(data.edges)),
          std::log1p(data.clock),
          std::log(light.frequency * static_cast<double>(light.box.width)),
          log_share(light.texture),
          log_share(1 - light.common),
          log_share(1 - data.periodic)};
}

double probability_of(const ToneFeatures& features) { return logistic(intercept, linear, square, features); }

double probability_of(const DataFeatures& features) {
  return logistic(data_intercept, data_linear, data_square, features);
}

}  // namespace ocisac
