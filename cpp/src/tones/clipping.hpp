// Levels at which samples pile up because light is clipped there.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "ocisac/core/region.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// Row i of some: phases of a tone and its cycles follow each other at low discrepancy, so that no period of the light
// hides rows. Without a tone the places do.
std::size_t some_row(std::size_t i, std::size_t rows, double cycles_per_row = 0);

// The smallest or the largest value of some samples where more have it than the value beside it (0: than half as
// many), as stored, and the smallest step between any two of them.
struct Pile {
  double level, beside, step;
};

// Lowest and highest pile of 64 rows of up to 16 columns about `column`, or of more rows of fewer; absent where
// values thin out, as noise does. `negative`: some samples are below `least`, of no light.
struct Piles {
  std::optional<Pile> low, high;
  bool negative = false;
};
Piles find_piles(const AnyFramesView& frames, std::size_t frame, std::size_t column, double least,
                 double cycles_per_row = 0);

// Up to `most` columns about `column`.
IndexRange columns_about(std::size_t column, std::size_t columns, std::size_t most);

// Samples of pairs of neighbouring rows, (columns × rows).
Eigen::MatrixXd samples_of_pairs(const AnyFramesView& frames, std::size_t frame, IndexRange columns, std::size_t pairs,
                                 double cycles_per_row);

// The largest step of which differences of 64 rows of 16 columns are multiples, as of integers in any type; of floats 0
// without one. Where samples do not differ, 1 and 0.
double step_of_samples(const AnyFramesView& frames);

// Samples of each column, (columns,): at the level, at the value beside it and beyond it, and runs of rows at the
// level.
struct PileCounts {
  std::vector<std::uint32_t> at, beside, beyond, runs;
};
PileCounts count_pile(const AnyFramesView& frames, std::size_t frame, const Pile& pile);

}  // namespace ocisac
