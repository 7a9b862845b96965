// Work in blocks over threads.
#pragma once

#include <cstddef>
#include <functional>

namespace ocisac {

// Calls work(block) once for each block in [0, blocks) on up to `threads` threads: the caller's own, and helpers that
// are kept from call to call, at most one for each further processor, which run where the thread that first asked for
// them might. A helper that comes when all blocks are taken is not waited for. Which thread takes which block is left
// open, so a block must write only what is its own; then the result does not depend on `threads`. The first exception
// is thrown again in the caller, after all blocks that were begun.
void for_each_block(std::size_t blocks, int threads, const std::function<void(std::size_t)>& work);

}  // namespace ocisac
