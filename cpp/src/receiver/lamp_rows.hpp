// Rows in which a lamp stands: those of lamps above each other, and those of a lamp's outline.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/core/views.hpp"
#include "ocisac/rows/chip_clock.hpp"

namespace ocisac {

// The rows, cut in the middle of dark runs that are no runs of chips: several times as long as all others. All rows
// where there is none. `noise`: standard deviation of the signal; NaN: not cut.
std::vector<RowRange> rows_of_lamps(std::span<const double> signal, double noise);

// Ellipse that fits the widths of the lamp in the rows of its bright chips. Absent where the lamp is none.
struct Outline {
  double middle, half, widest;  // rows, rows, columns

  // Columns, 0 beyond the lamp.
  [[nodiscard]] double width(double row) const;
};
std::optional<Outline> outline_of(const AnyFramesView& frames, std::size_t frame, std::span<const double> weights,
                                  std::span<const std::size_t> bright_rows);

}  // namespace ocisac
