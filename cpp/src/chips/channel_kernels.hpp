// Rows of chips and products of columns, for the least squares of a channel; compiled once for each SIMD target.
#pragma once

#include <cstddef>
#include <span>

namespace ocisac::kernels {

constexpr std::size_t kRowGroup = 8;  // rows: a multiple of a vector of double of any target

// Light of each chip, at once there from its beginning to its end; its sum over the chips before each.
struct ChipSteps {
  const double *targets, *sums;
  std::size_t count;  // at least 1
};

// Rows from `first` on; `chip`: index in the tables of the chip that begins at the clock's phase.
struct ExposureClock {
  double first, chip;
  double phase, rows_per_chip, exposure_rows;
};

// s of each row and its derivatives by phase, rows per chip and exposure.
struct ExposedRows {
  double *value, *by_phase, *by_period, *by_exposure;
};

// `rows`: a multiple of kRowGroup. The first and the last chip extend without end.
void expose_rows(const ChipSteps& chips, const ExposureClock& clock, std::size_t rows, const ExposedRows& to);

// Rows and the columns of which levels make them: values ≈ Σ dark[k]·basis_k + exposed·Σ swing[k]·basis_k.
struct LevelColumns {
  const double *basis, *exposed, *values;  // basis_k: `stride` values after basis_(k − 1); basis_0: 1, or 0
  std::size_t stride;
  std::span<const double> dark, swing;  // one level or more
};

// Swing of each row, as if basis_0 were 1, and what the levels leave of the values; `rows`: a multiple of kRowGroup.
void subtract_levels(const LevelColumns& columns, std::size_t rows, double* swing, double* left);

// products[i·stride + j] = products[j·stride + i] = Σ column i·column j, for i ≥ first and j ≤ i, over `rows`, a
// multiple of kRowGroup.
void inner_products(std::span<const double* const> columns, std::size_t first, std::size_t rows, double* products,
                    std::size_t stride);

}  // namespace ocisac::kernels
