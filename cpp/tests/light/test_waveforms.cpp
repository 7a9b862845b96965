#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <stdexcept>
#include <utility>
#include <vector>

#include "light/instants.hpp"
#include "light/time_line.hpp"
#include "ocisac/light/integrate_exposure.hpp"
#include "ocisac/light/waveform.hpp"

namespace {

using ocisac::Camera;
using ocisac::Waveform;

Camera camera_with(double exposure) { return {22.2e-6, exposure, 1.0 / 30, {}}; }

std::vector<double> means(const Waveform& waveform, const Camera& camera, const std::vector<std::int64_t>& rows,
                          double start = 0, std::int64_t frame = 0) {
  std::vector<double> out(rows.size());
  ocisac::integrate_exposure(waveform, camera, rows, start, frame, out);
  return out;
}

std::vector<std::int64_t> first_rows(std::size_t count) {
  std::vector<std::int64_t> rows(count);
  std::iota(rows.begin(), rows.end(), 0);
  return rows;
}

double midpoint_rule(const Waveform& waveform, double end, double exposure) {
  constexpr std::size_t points = 20000;
  std::vector<double> times(points), values(points);
  for (std::size_t i = 0; i < points; ++i)
    times[i] = end - exposure * (static_cast<double>(i) + 0.5) / static_cast<double>(points);
  ocisac::sample_waveform(waveform, times, values);
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(points);
}

}  // namespace

TEST_CASE("counts of cycles keep their fraction") {
  const ocisac::TimeLine line{{1e4, 0}, 0x1p-16};
  const ocisac::CycleCounter counter({1234.5, 0}, line, {0.25, 0});
  const auto at = counter.at(65536 * 7 + 3);
  CHECK(at.whole + at.fraction == 12353641.75 + 3 * 1234.5 / 65536);
  CHECK(std::abs(at.fraction) <= 0.5);
  CHECK(ocisac::turns(7.5 * std::numbers::pi).value() == doctest::Approx(3.75).epsilon(1e-15));
}

constexpr auto kCycles = ocisac::Instants::Count::cycles, kFractions = ocisac::Instants::Count::fractions;

TEST_CASE("split counts of cycles add up without error") {
  std::vector<double> times;
  for (int i = 0; i < 3000; ++i) times.push_back(1e9 * std::sin(i));
  const ocisac::DoubleDouble step{1234.56789, 1e-14};
  ocisac::Instants few({times.data(), 10}), many(times);
  for (const auto& [instants, first] : {std::pair(&few, 3), std::pair(&many, 2990)}) {
    const auto counted = instants->counted(kCycles, step, static_cast<std::size_t>(first), 7);
    for (std::size_t i = 0; i < 7; ++i) {
      const double x = instants->x()[static_cast<std::size_t>(first) + i];
      CHECK(std::remainder(counted.coarse[i], counted.grid) == 0);
      CHECK(std::abs(counted.fine[i]) <= counted.grid / 2);
      const auto product = ocisac::DoubleDouble{x, 0} * step;
      const auto left = product - ocisac::exact_sum(counted.coarse[i], counted.fine[i]);
      CHECK(std::abs(left.value()) < 1e-19);
    }
  }
  const auto cycles = many.counted(kCycles, step, 0, 3000), fractions = many.counted(kFractions, step, 0, 3000);
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
  const double* const first = instants.counted(kCycles, {0.1, 0}, 1000, 10).coarse;
  for (double step : {0.2, 0.3, 0.4, 0.5}) {
    const auto counted = instants.counted(kCycles, {step, 0}, 1000, 10);
    for (std::size_t i = 0; i < 10; ++i)
      CHECK(counted.coarse[i] + counted.fine[i] ==
            doctest::Approx(step * static_cast<double>(1000 + i)).epsilon(1e-15));
  }
  CHECK(instants.counted(kCycles, {0.1, 0}, 1000, 10).coarse == first);
}

TEST_CASE("means agree with sums over many points") {
  const std::vector<Waveform> waveforms = {
      ocisac::Tone{500, 2, 0.3, 0.7},
      ocisac::SquareWave{700, 0.3, 1.5, -1.0},
      ocisac::TriangleWave{700, 1.5, -1.0, 0.8},
      ocisac::TriangleWave{0, 1.5, -1.0, 0.8},
      ocisac::Chips{{0, 1, 1, 0.5}, 3e3, 0.001, true, 2},
      ocisac::Chips{{0, 1, 1, 0.5}, 3e3, 0.001},
      ocisac::Chips{{0, 1, 1, 0.5}, 3e3, 0.001, true, 2, 0.5, 2},
      ocisac::Chips{{0, 1, 1, 0.5}, 3e3, 0.001, false, 1, 0, 2},
      ocisac::Samples{{0, 1, 1, 0.5}, 3e3, 0.001, true},
      ocisac::Samples{{0, 1, 1, 0.5}, 3e3, 0.001},
      2.0 * Waveform(ocisac::Tone{500}) + 0.5,
      Waveform(ocisac::Tone{500, 2, 0.3, 0.7}) * ocisac::SquareWave{175, 0.4, 1, 0.5},
      (Waveform(ocisac::Tone{500}) + 0.5) * ocisac::Samples{{0, 1, 1, 0.5}, 3e3, 0.001, true} *
          ocisac::Chips{{0, 1, 1}, 1e3, 0, true},
  };
  for (const Waveform& waveform : waveforms)
    for (double exposure : {0.0, 4e-5, 622e-6, 0.02}) {
      const auto got = means(waveform, camera_with(exposure), {0, 77, -3, 500});
      const double ends[] = {0, 77 * 22.2e-6, -3 * 22.2e-6, 500 * 22.2e-6};
      for (std::size_t i = 0; i < 4; ++i)
        CHECK(got[i] == doctest::Approx(midpoint_rule(waveform, ends[i], exposure)).epsilon(1e-3));
    }
}

TEST_CASE("a tone has gain sinc(f T_e) and a delay of half an exposure") {
  const auto got = means(ocisac::Tone{500}, camera_with(622e-6), first_rows(1080));
  const double gain = std::sin(std::numbers::pi * 0.311) / (std::numbers::pi * 0.311);
  for (std::size_t n = 0; n < got.size(); ++n) {
    const double middle = static_cast<double>(n) * 22.2e-6 - 311e-6;
    CHECK(got[n] == doctest::Approx(0.5 + 0.5 * gain * std::cos(2 * std::numbers::pi * 500 * middle)).epsilon(1e-12));
  }
}

TEST_CASE("chips of on-off keying are exact") {
  const Waveform chips = ocisac::Chips{{1, 0, 1, 1}, 1024, 0, true};
  const Camera camera{0x1p-14, 0x1p-9, 1.0, {}};  // 16 rows a chip, 2 chips an exposure
  const auto got = means(chips, camera, {32, 40, 64, 68, 1 << 30}, 0, 1000000);
  CHECK(got == std::vector<double>{0.5, 0.5, 1.0, 1.0, 1.0});
}

TEST_CASE("values without meaning are refused") {
  CHECK_THROWS_AS(Waveform(ocisac::Tone{-1}), std::invalid_argument);
  CHECK_THROWS_AS(Waveform(ocisac::SquareWave{1, 1.0}), std::invalid_argument);
  CHECK_THROWS_AS(Waveform(ocisac::TriangleWave{1, 1, 0, 1.5}), std::invalid_argument);
  CHECK_THROWS_AS(Waveform(ocisac::Chips{{}, 1}), std::invalid_argument);
  CHECK_THROWS_AS(Waveform(ocisac::Samples{{1, NAN}, 1}), std::invalid_argument);
  const Waveform sampled = ocisac::Samples{{1, 2}, 1};
  CHECK_THROWS_AS(sampled * sampled, std::invalid_argument);
  const Waveform slow = ocisac::Chips{{0, 1}, 1, 0, true, 1, 0.5};
  CHECK_NOTHROW(slow * 2.0);
  CHECK_THROWS_AS(slow * ocisac::Tone{500}, std::invalid_argument);
  CHECK_THROWS_AS(Waveform(ocisac::Chips{{0, 1}, 1, 0, true, 1, 0, 2000}), std::invalid_argument);
  CHECK_THROWS_AS(means(1.0, Camera{1e-5, {}, {}, {}}, {0}), std::invalid_argument);
  CHECK_THROWS_AS(means(1.0, Camera{1e-5, 1e-4, {}, {}}, {0}, 0, 1), std::invalid_argument);
  CHECK_THROWS_AS(means(1.0, camera_with(1e-4), {}), std::invalid_argument);
  CHECK_THROWS_AS(means(1.0, camera_with(1e-4), {std::int64_t{1} << 60}), std::invalid_argument);
}
