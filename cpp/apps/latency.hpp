// Percentiles of many times in bounded memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace ocisac::apps {

// Counts in bins that grow by 1/32 of an octave, from 100 ns to 100 s; a percentile is good to 2.2 %, the largest
// exact.
class Latency {
 public:
  void add(double seconds);

  // The smallest time that `share` of all do not exceed, s, (0, 1]; NaN of none.
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
