#include "ocisac/tones/read_bytes.hpp"

#include <algorithm>
#include <atomic>

#include "core/parallel.hpp"
#include "tones/byte_kernels.hpp"

namespace ocisac {

std::uint64_t read_bytes(std::span<const std::uint8_t> bytes, int threads) {
  if (threads == 1) return kernels::read_bytes(bytes.data(), bytes.size());
  constexpr std::size_t kPerBlock = 1 << 19;
  std::atomic<std::uint64_t> sum = 0;
  for_each_block((bytes.size() + kPerBlock - 1) / kPerBlock, threads, [&](std::size_t block) {
    const auto part = bytes.subspan(block * kPerBlock);
    sum += kernels::read_bytes(part.data(), std::min(part.size(), kPerBlock));
  });
  return sum;
}

}  // namespace ocisac
