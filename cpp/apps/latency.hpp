// Percentiles of many durations in bounded memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace ocisac::apps {

// Histogram with bins of 1/32 octave from 100 ns to 100 s: percentiles are accurate to 2.2 %, the largest value is
// exact.
class Latency {
 public:
  void add(double seconds);

  // The smallest time that at least `share` of all values do not exceed, s, `share` in (0, 1]; NaN without values.
  [[nodiscard]] double percentile(double share) const;
  [[nodiscard]] double largest() const { return largest_; }
  [[nodiscard]] double mean() const;

 private:
  static constexpr std::size_t kBins = 960;

  std::array<std::uint64_t, kBins> counts_{};
  std::uint64_t count_ = 0;
  double largest_ = 0, sum_ = 0;
};

}  // namespace ocisac::apps
