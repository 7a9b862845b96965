// Common to the fuzz targets. Each one turns bytes into calls; what a call may do is return or throw
// std::invalid_argument. All else is a finding: other exceptions, sanitizer reports, claims that do not hold, leaks.
#pragma once

#include <fuzzer/FuzzedDataProvider.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

namespace ocisac::fuzz {

// A claim about an answer.
inline void claim(bool holds) {
  if (!holds) std::abort();
}

// Calls `body`; invalid arguments may be refused.
template <class Body>
void allow_refusal(Body body) {
  try {
    body();
  } catch (const std::invalid_argument&) {
  }
}

}  // namespace ocisac::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
