#include "latency.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace ocisac::apps {

namespace {

constexpr double kShortest = 1e-7;  // s
constexpr double kBinsPerOctave = 32;

}  // namespace

void Latency::add(double seconds) {
  const double bin = std::ceil(kBinsPerOctave * std::log2(std::max(seconds, kShortest) / kShortest));
  ++counts_[std::min(static_cast<std::size_t>(bin), kBins - 1)];
  ++count_;
  sum_ += seconds;
  largest_ = std::max(largest_, seconds);
}

double Latency::percentile(double share) const {
  if (count_ == 0) return std::numeric_limits<double>::quiet_NaN();
  const double wanted = share * static_cast<double>(count_);
  std::uint64_t below = 0;
  for (std::size_t bin = 0; bin < kBins; ++bin) {
    below += counts_[bin];
    if (static_cast<double>(below) >= wanted)
      return std::min(largest_, kShortest * std::exp2(static_cast<double>(bin) / kBinsPerOctave));
  }
  return largest_;
}

double Latency::mean() const {
  return count_ == 0 ? std::numeric_limits<double>::quiet_NaN() : sum_ / static_cast<double>(count_);
}

}  // namespace ocisac::apps
