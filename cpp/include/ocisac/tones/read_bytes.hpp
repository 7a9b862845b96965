// The yardstick of speed: bytes merely read.
#pragma once

#include <cstdint>
#include <span>

namespace ocisac {

// Sum of all bytes, with the SIMD of the target in use (see simd_target): what it takes to read a frame, for measuring.
std::uint64_t read_bytes(std::span<const std::uint8_t> bytes, int threads = 1);

}  // namespace ocisac
