// Times of the whole calls of calls.hpp. Each must give the same twice, and a number.
#include "calls.hpp"

#include <benchmark/benchmark.h>

namespace {

const bool registered = [] {
  for (const auto& [name, work] : calls::kCases)
    benchmark::RegisterBenchmark(name.c_str(), [work = work](benchmark::State& state) {
      const double result = work();
      if (!std::isfinite(result) || result != work()) return state.SkipWithError("another result in a second call");
      for (auto _ : state) benchmark::DoNotOptimize(work());
    });
  return true;
}();

}  // namespace
