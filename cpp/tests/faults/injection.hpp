// Makes the n-th call of one kind fail, in the program or, preloaded, in another one.
#pragma once

#include <array>

namespace ocisac::faults {

enum class Kind { allocation, read, write, map, thread };
inline constexpr std::array kKindNames{"allocation", "read", "write", "mmap", "thread"};

// From now on call number `n` (from 1) of `kind` fails, once.
void arm(Kind kind, long n);

// Number of calls of the kind since arm(); no call fails from now on.
long disarm();

// Allocations that are not freed.
long live_allocations();

// The allocation that failed was OpenCV's: its DFT does not free its plan then.
bool failed_in_opencv();

}  // namespace ocisac::faults
