#include "lights/light_probability.hpp"

#include <algorithm>
#include <cmath>

#include "core/softplus.hpp"

namespace ocisac {

namespace {

constexpr double rounding = 0.01;       // of shares near 0
constexpr double clear_texture = 0.25;  // below it noise, which log light shows in dark rows, makes texture uneven

constexpr std::size_t kOthers = 9;
// From the fit to what users see, by bench/light_probability.py: weights of −ln(1 − p) and ln p, a logit, and that of a
// picture where more than `many` others are expected.
constexpr double above = 1.21, below = 0.79, shift = -0.49, many_lights = 0.8, many = 10;
constexpr double intercept = -18.673;
constexpr ToneFeatures linear{-1.029, 4.853, 1.9, -0.546, -1.407, -3.92, -0.248, 4.782, 0.17, 1.646, 0.148};
constexpr ToneFeatures square{0, -0.198, -0.271, -0.06, 6.883, -0.553, -0.114, -3.047, 2.032, -0.208, 0.364};
constexpr double inner_intercept = -7.623;
constexpr ToneFeatures inner_linear{-0.954, 3.034, 2.592, -0.989, 0.976, 1.666, -0.587, 6.602, 1.124, 1.34, -0.771};
constexpr ToneFeatures inner_square{0, -0.629, -0.292, 0.078, -4.245, 0.236, -0.004, -7.434, -0.725, 0.024, 0.083};
constexpr double data_intercept = -6.959;
constexpr DataFeatures data_linear{-1, 0.662, 0.131, 1.561, -1.526, 0.215, -9.803};
constexpr DataFeatures data_square{0, 0.092, 0.288, 0.15, 0.148, 0.019, -6.611};

double log_share(double share) { return std::log(std::max(share, 0.0) + rounding); }

double logistic(double logit) { return 1 / (1 + std::exp(-logit)); }

template <class Features>
double logit(double sum, const Features& linear_terms, const Features& square_terms, const Features& features) {
  for (std::size_t i = 0; i < linear_terms.size(); ++i)
    sum += (linear_terms[i] + square_terms[i] * features[i]) * features[i];
  return sum;
}

double tone_logit(const ToneFeatures& features, bool inside) {
  return inside ? logit(inner_intercept, inner_linear, inner_square, features)
                : logit(intercept, linear, square, features);
}

}  // namespace

ToneFeatures features_of(const RefinedLight& light, std::size_t suspects, double others) {
  const double cycles = light.frequency * static_cast<double>(light.box.height);
  return {std::log(static_cast<double>(std::max<std::size_t>(suspects, 1))),
          std::log(cycles),
          std::log(light.frequency * static_cast<double>(light.box.width)),
          log_share(light.texture),
          light.uneven * std::min(light.texture / clear_texture, 1.0),
          log_share(1 - light.periodic),
          log_share(1 - light.common),
          std::min(light.depth, 1.0),
          light.contour,
          std::log1p(others),
          log_share(light.across)};
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

double probability_of(const ToneFeatures& features, bool inside) { return logistic(tone_logit(features, inside)); }

// ln p = −softplus(−z) and ln(1 − p) = −softplus(z) for p = logistic(z).
double corrected_probability_of(const ToneFeatures& features, bool inside) {
  const double z = tone_logit(features, inside), others = std::expm1(features[kOthers]);
  return logistic(above * softplus(z) - below * softplus(-z) + shift + many_lights * logistic(others - many));
}

double probability_of(const DataFeatures& features) {
  return logistic(logit(data_intercept, data_linear, data_square, features));
}

}  // namespace ocisac
