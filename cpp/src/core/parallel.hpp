// Work in blocks over threads.
#pragma once

#include <cstddef>
#include <functional>

namespace ocisac {

// Calls work(block) once for each block in [0, blocks) on up to `threads` threads: the caller's own and helpers.
// Helpers are kept from call to call, at most one for each further processor, with the processor affinity of the thread
// that first needed them. The call does not wait for a helper that starts when no block is left. The assignment of
// blocks to threads is arbitrary: a block writes only its own results, so the result does not depend on `threads`. The
// first exception is rethrown in the caller after all blocks that had started.
void for_each_block(std::size_t blocks, int threads, const std::function<void(std::size_t)>& work);

}  // namespace ocisac
