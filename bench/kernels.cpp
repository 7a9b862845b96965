// Every kernel of the tests' list (cpp/tests/kernels) on the best SIMD target. Each case is checked before timing.
#include <benchmark/benchmark.h>

#include "kernels/kernel_cases.hpp"

namespace {

const bool registered = [] {
  for (const auto& one : kernel_cases::all())
    if (one.run)
      benchmark::RegisterBenchmark(one.name.c_str(), [one](benchmark::State& state) {
        if (!(one.deviation() <= one.tolerance)) return state.SkipWithError("not what the plain loop gives");
        for (auto _ : state) {
          one.run();
          benchmark::ClobberMemory();
        }
      });
  return true;
}();

}  // namespace
