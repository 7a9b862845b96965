#include "ocisac/estimation/read_bytes.hpp"

#include "estimation/projection_kernels.hpp"

namespace ocisac {

std::uint64_t read_bytes(std::span<const std::uint8_t> bytes) {
  return kernels::read_bytes(bytes.data(), bytes.size());
}

}  // namespace ocisac
