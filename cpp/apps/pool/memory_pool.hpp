// The memory of ocisac-rx: blocks that are given back are kept and given out again, so that a program that does the
// same frame after frame asks nothing more of the system.
#pragma once

#include <cstddef>

namespace ocisac::apps {

struct PoolUse {
  std::size_t bytes = 0;          // taken of the arena so far; never given back
  std::size_t system_blocks = 0;  // asked of the system: too long for the pool, or the arena full
};

PoolUse pool_use();

// Memory aligned to 64 bytes, nullptr where there is none. Constant time. Any thread.
void* pool_take(std::size_t bytes);
// `block`: of pool_take() or the system's malloc.
void pool_give(void* block);
// Bytes that a block of the pool can hold; 0 for one of the system's.
std::size_t pool_length(const void* block);

}  // namespace ocisac::apps
