#include <doctest/doctest.h>

#include <set>

#include "kernel_cases.hpp"
#include "ocisac/tones/projection.hpp"

TEST_CASE("every kernel agrees with its plain loop on every SIMD target") {
  const auto cases = kernel_cases::all();
  const auto targets = ocisac::simd_targets();
  REQUIRE(!targets.empty());
  for (const auto& target : targets) {
    CAPTURE(target);
    ocisac::force_simd_target(target);
    CHECK(ocisac::simd_target() == target);  // reported by the code that runs
    for (const auto& one : cases) {
      CAPTURE(one.name);
      CHECK(one.deviation() <= one.tolerance);
    }
  }
  ocisac::force_simd_target("");
}

TEST_CASE("every kernel is timed once or more, and deviations are seen") {
  std::set<std::string> kernels, timed;
  for (const auto& one : kernel_cases::all()) {
    const auto kernel = one.name.substr(0, one.name.find(' '));
    kernels.insert(kernel);
    if (one.run) timed.insert(kernel);
  }
  CHECK(kernels == timed);
  const std::vector<double> want{1, -2}, close{1, -2.5}, nan{1, NAN};
  CHECK(kernel_cases::deviation<double>(close, want) == 0.25);
  CHECK(kernel_cases::deviation<double>(nan, want) == kernel_cases::kInfinite);
  CHECK(kernel_cases::deviation<double>(nan, nan) == 0);
}
