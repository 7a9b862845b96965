#include <cstdint>
#include <numbers>

#include "columns/row_kernels.hpp"
#include "kernel_cases.hpp"
#include "tones/harmonic_kernels.hpp"

namespace kernel_cases {

namespace {

// cos and sin of the harmonics at a distance u.
struct Waves {
  std::vector<double> cosine, sine;

  Waves(std::size_t count, double frequency, double u) {
    for (std::size_t h = 1; h <= count; ++h) {
      const double angle = 2 * std::numbers::pi * std::fmod(static_cast<double>(h) * frequency * u, 1.0);
      cosine.push_back(std::cos(angle));
      sine.push_back(std::sin(angle));
    }
  }
};

// (4 × harmonics)
KernelCase harmonics_case(std::size_t rows, std::size_t count) {
  constexpr std::size_t kStep = 3;
  const double first = rows % 2 == 0 ? 0.5 : 0.0, frequency = 0.0117;
  auto even = std::make_shared<Misaligned<double>>(random_rows<double>(1, kStep * rows, kStep * rows));
  auto odd = std::make_shared<Misaligned<double>>(random_rows<double>(1, kStep * rows, kStep * rows));
  const Waves at(count, frequency, first), turn(count, frequency, 1), leap(count, frequency, 16);
  const auto run = [=](bool plain, double* out) {
    if (!plain)
      return ocisac::kernels::harmonic_sums({even->data(), odd->data(), kStep, rows, first},
                                            {at.cosine.data(), at.sine.data(), turn.cosine.data(), turn.sine.data(),
                                             leap.cosine.data(), leap.sine.data(), count},
                                            {out, out + count, out + 2 * count, out + 3 * count});
    std::fill_n(out, 4 * count, 0.0);
    for (std::size_t i = 0; i < rows; ++i) {
      const double u = first + static_cast<double>(i), a = even->data()[kStep * i], b = odd->data()[kStep * i];
      const Waves here(count, frequency, u);
      for (std::size_t h = 0; h < count; ++h) {
        out[h] += a * here.cosine[h];
        out[count + h] += b * here.sine[h];
        out[2 * count + h] += a * u * here.sine[h];
        out[3 * count + h] += b * u * here.cosine[h];
      }
    }
  };
  return kernel_case<double>("harmonic_sums " + std::to_string(rows) + " rows, " + std::to_string(count), 1e-12,
                             {4, count, count}, run, rows > 500);
}

// (2 × runs): sums, and how many reach the level.
KernelCase runs_case(std::size_t columns, std::size_t width, unsigned level) {
  auto row = std::make_shared<Misaligned<std::uint8_t>>(random_rows<std::uint8_t>(1, columns, columns, 120, 80));
  const std::size_t runs = (columns + width - 1) / width;
  const auto run = [=](bool plain, std::uint32_t* out) {
    if (!plain) return ocisac::kernels::sum_runs(row->data(), columns, width, level, out, out + runs);
    std::fill_n(out, 2 * runs, 0U);
    for (std::size_t c = 0; c < columns; ++c) {
      out[c / width] += row->data()[c];
      out[runs + c / width] += row->data()[c] >= level;
    }
  };
  return kernel_case<std::uint32_t>("sum_runs " + std::to_string(columns) + " bytes by " + std::to_string(width), 0,
                                    {2, runs, runs}, run, columns > 1000);
}

}  // namespace

std::vector<KernelCase> frequency_cases() {
  std::vector<KernelCase> cases;
  for (const std::size_t count : {8u, 16u, 32u})
    for (const std::size_t rows : {1u, 2u, 15u, 16u, 17u, 540u}) cases.push_back(harmonics_case(rows, count));
  for (const std::size_t columns : kLengths)
    for (const std::size_t width : {1u, 2u, 7u, 32u, 69u})
      for (const unsigned level : {0u, 130u, 255u, 256u}) cases.push_back(runs_case(columns, width, level));
  cases.push_back(runs_case(1920, 30, 255));
  cases.push_back(runs_case(1920, 100, 200));
  return cases;
}

}  // namespace kernel_cases
