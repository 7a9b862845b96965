// The place in long loops where the caller's check for an interrupt is called.
#pragma once

#include "ocisac/core/interrupt.hpp"

namespace ocisac {

// Some 30 ns where nothing is due: for loops whose bodies take a microsecond or more. Throws what the check throws.
void check_interrupt();

// While one lives, its thread is a helper and makes no checks: the caller's thread does.
class WithoutInterrupts {
 public:
  WithoutInterrupts();
  ~WithoutInterrupts();
  WithoutInterrupts(const WithoutInterrupts&) = delete;
  WithoutInterrupts& operator=(const WithoutInterrupts&) = delete;
};

}  // namespace ocisac
