// Speed reference: the time of reading bytes.
#pragma once

#include <cstdint>
#include <span>

namespace ocisac {

// Sum of all bytes with the current SIMD target (see simd_target), to measure the time of reading a frame.
std::uint64_t read_bytes(std::span<const std::uint8_t> bytes, int threads = 1);

}  // namespace ocisac
