#include <cstdint>

#include "columns/row_kernels.hpp"
#include "kernel_cases.hpp"

namespace kernel_cases {

namespace {

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
  for (const std::size_t columns : kLengths)
    for (const std::size_t width : {1u, 2u, 7u, 32u, 69u})
      for (const unsigned level : {0u, 130u, 255u, 256u}) cases.push_back(runs_case(columns, width, level));
  cases.push_back(runs_case(1920, 30, 255));
  cases.push_back(runs_case(1920, 100, 200));
  return cases;
}

}  // namespace kernel_cases
