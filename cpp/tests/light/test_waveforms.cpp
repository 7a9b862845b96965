#include <doctest/doctest.h>

#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>
#include <vector>

#include "light/instants.hpp"
#include "light/time_line.hpp"

TEST_CASE("counts of cycles keep their fraction") {
  const ocisac::TimeLine line{{1e4, 0}, 0x1p-16};
  const ocisac::CycleCounter counter({1234.5, 0}, line, {0.25, 0});
  const auto at = counter.at(65536 * 7 + 3);
  CHECK(at.whole + at.fraction == 12353641.75 + 3 * 1234.5 / 65536);
  CHECK(std::abs(at.fraction) <= 0.5);
  CHECK(ocisac::turns(7.5 * std::numbers::pi).value() == doctest::Approx(3.75).epsilon(1e-15));
}

TEST_CASE("split counts of cycles add up without error") {
  std::vector<double> times;
  for (int i = 0; i < 3000; ++i) times.push_back(1e9 * std::sin(i));
  const ocisac::DoubleDouble step{1234.56789, 1e-14};
  ocisac::Instants few({times.data(), 10}), many(times);
  for (const auto& [instants, first] : {std::pair(&few, 3), std::pair(&many, 2990)}) {
    const auto counted = instants->counted(false, step, static_cast<std::size_t>(first), 7);
    for (std::size_t i = 0; i < 7; ++i) {
      const double x = instants->x()[static_cast<std::size_t>(first) + i];
      CHECK(std::remainder(counted.coarse[i], counted.grid) == 0);
      CHECK(std::abs(counted.fine[i]) <= counted.grid / 2);
      const auto product = ocisac::DoubleDouble{x, 0} * step;
      const auto left = product - ocisac::exact_sum(counted.coarse[i], counted.fine[i]);
      CHECK(std::abs(left.value()) < 1e-19);
    }
  }
  const auto cycles = many.counted(false, step, 0, 3000), fractions = many.counted(true, step, 0, 3000);
  for (std::size_t i = 0; i < 3000; ++i) {
    CHECK(std::abs(fractions.coarse[i]) <= 0.5);
    CHECK(std::abs(fractions.fine[i]) <= 0x1p-50);
    const double whole = cycles.coarse[i] - fractions.coarse[i] + (cycles.fine[i] - fractions.fine[i]);
    CHECK(whole == doctest::Approx(std::round(whole)).epsilon(1e-15));
  }
  CHECK(cycles.coarse[0] == 0);
  CHECK_FALSE(many.is_even());
  for (double& time : times) time = 0.25 * static_cast<double>(&time - times.data());
  CHECK(ocisac::Instants(times).is_even());
}

TEST_CASE("tables of counts have a bound, beyond which blocks are counted") {
  std::vector<double> rows(300'000);
  std::iota(rows.begin(), rows.end(), 0);
  ocisac::Instants instants(rows);
  const double* const first = instants.counted(false, {0.1, 0}, 1000, 10).coarse;
  for (double step : {0.2, 0.3, 0.4, 0.5}) {
    const auto counted = instants.counted(false, {step, 0}, 1000, 10);
    for (std::size_t i = 0; i < 10; ++i)
      CHECK(counted.coarse[i] + counted.fine[i] ==
            doctest::Approx(step * static_cast<double>(1000 + i)).epsilon(1e-15));
  }
  CHECK(instants.counted(false, {0.1, 0}, 1000, 10).coarse == first);
}
