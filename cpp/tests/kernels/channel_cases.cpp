#include "chips/channel_kernels.hpp"
#include "kernel_cases.hpp"
#include "rows/exposed_chips.hpp"

namespace kernel_cases {

namespace {

using ocisac::kernels::kRowGroup;

// value, by_phase, by_period, by_exposure; beyond either end of the chips as well.
KernelCase exposure_case(std::size_t chips, std::size_t rows, double rows_per_chip, double exposure_rows) {
  const auto levels = std::make_shared<std::vector<double>>(chips);
  std::mt19937 source(3);
  for (double& level : *levels) level = static_cast<double>(source() % 2);
  const auto box = std::make_shared<ocisac::ChipBox>(ocisac::KnownChips{*levels, -4}, ocisac::ChipClock{});
  const double first = 11, middle = first + 0.5 * static_cast<double>(rows);
  const double of_chip = 0.5 * static_cast<double>(chips);
  const ocisac::ChipClock clock{rows_per_chip, middle + 0.3, exposure_rows};  // of the middle chip
  const auto run = [=](bool plain, double* out) {
    if (!plain)
      return ocisac::kernels::expose_rows(
          {box->targets().data(), box->sums().data(), chips},
          {first, of_chip - box->first(), clock.phase, clock.rows_per_chip, clock.exposure_rows}, rows,
          {out, out + rows, out + 2 * rows, out + 3 * rows});
    for (std::size_t n = 0; n < rows; ++n) {
      const auto seen = box->at(first + static_cast<double>(n), clock, of_chip);
      out[n] = seen.value;
      out[rows + n] = seen.by_phase;
      out[2 * rows + n] = seen.by_period;
      out[3 * rows + n] = seen.by_exposure;
    }
  };
  return kernel_case<double>(
      "expose_rows " + std::to_string(rows) + " of " + std::to_string(chips) + " chips", 1e-12, {4, rows, rows},
      [levels, run](bool plain, double* out) { run(plain, out); }, rows > 100);
}

// swing, left; basis_0 is 0 in the last rows.
KernelCase levels_case(std::size_t dark_size, std::size_t swing_size, std::size_t rows) {
  const std::size_t stride = rows + 3;
  const auto basis = std::make_shared<Misaligned<double>>(random_rows<double>(8, rows, stride));
  for (std::size_t n = 0; n < rows; ++n) basis->data()[n] = n + 5 < rows ? 1 : 0;
  const auto levels = std::make_shared<std::vector<double>>(std::vector<double>{3, -0.4, 0.2, 0.1, -0.3, 0.7});
  const auto run = [=](bool plain, double* out) {
    const std::span<const double> dark(levels->data(), dark_size), swing(levels->data() + 1, swing_size);
    const double *const columns = basis->data(), *exposed = columns + 6 * stride, *values = columns + 7 * stride;
    if (!plain)
      return ocisac::kernels::subtract_levels({columns, exposed, values, stride, dark, swing}, rows, out, out + rows);
    for (std::size_t n = 0; n < rows; ++n) {
      double of_dark = dark[0];
      out[n] = swing[0];
      for (std::size_t k = 1; k < dark_size; ++k) of_dark += dark[k] * columns[k * stride + n];
      for (std::size_t k = 1; k < swing_size; ++k) out[n] += swing[k] * columns[k * stride + n];
      out[rows + n] = values[n] - columns[n] * of_dark - exposed[n] * out[n];
    }
  };
  return kernel_case<double>("subtract_levels of " + std::to_string(dark_size) + " and " + std::to_string(swing_size),
                             1e-14, {2, rows, rows}, run, rows > 100);
}

// (columns × columns), from a row on.
KernelCase products_case(std::size_t count, std::size_t first, std::size_t rows) {
  const auto values = std::make_shared<Misaligned<double>>(random_rows<double>(count, rows, rows));
  const auto run = [=](bool plain, double* out) {
    std::vector<const double*> columns;
    for (std::size_t k = 0; k < count; ++k) columns.push_back(values->data() + k * rows);
    std::fill_n(out, count * count, 0.5);
    if (!plain) return ocisac::kernels::inner_products(columns, first, rows, out, count);
    for (std::size_t i = first; i < count; ++i)
      for (std::size_t j = 0; j < count; ++j) {
        double sum = 0;
        for (std::size_t n = 0; n < rows; ++n) sum += columns[i][n] * columns[j][n];
        out[i * count + j] = out[j * count + i] = sum;
      }
  };
  return kernel_case<double>(
      "inner_products of " + std::to_string(count) + " columns, " + std::to_string(rows) + " rows", 1e-12,
      {1, count * count, count * count}, run, rows > 100);
}

}  // namespace

std::vector<KernelCase> channel_cases() {
  std::vector<KernelCase> cases;
  for (const std::size_t chips : {1, 3, 7, 40, 200}) {
    for (const double rows_per_chip : {0.7, 1.5, 2.0, 5.63})
      for (const double exposure_chips : {1e-3, 0.4, 1.0, 6.3})
        cases.push_back(exposure_case(chips, 3 * kRowGroup, rows_per_chip, exposure_chips * rows_per_chip));
    cases.push_back(exposure_case(chips, 29 * kRowGroup, 5.63, 28.0));
  }
  for (const std::size_t dark : {1, 2, 5})
    for (const std::size_t swing : {std::size_t{1}, dark})
      for (const std::size_t rows : {kRowGroup, 29 * kRowGroup}) cases.push_back(levels_case(dark, swing, rows));
  for (const std::size_t count : {1, 2, 5, 8, 18})
    for (const std::size_t first : {std::size_t{0}, count / 2, count - 1})
      for (const std::size_t rows : {kRowGroup, 5 * kRowGroup, 29 * kRowGroup})
        cases.push_back(products_case(count, first, rows));
  return cases;
}

}  // namespace kernel_cases
