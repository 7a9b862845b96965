// A channel as ocisac_fast.chips passes it.
#pragma once

#include <pybind11/stl.h>

#include <array>
#include <utility>
#include <vector>

#include "ocisac/chips/channel_estimate.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac::bindings {

namespace py = pybind11;

inline ChannelEstimate channel_of(const py::tuple& values) {
  const auto dark = values[4].cast<std::vector<double>>(), swing = values[5].cast<std::vector<double>>();
  for (const auto* levels : {&dark, &swing})
    require(!levels->empty() && levels->size() <= kHighestDegree + 1, levels == &dark ? "dark" : "swing",
            levels->size(), "1 to 7 coefficients");
  const auto errors = values[3].cast<std::pair<std::ptrdiff_t, std::array<double, 9>>>();
  return {{values[0].cast<double>(), values[1].cast<double>(), values[2].cast<double>()},
          {errors.first, errors.second},
          dark,
          swing,
          values[6].cast<double>(),
          {values[7].cast<std::size_t>(), values[8].cast<std::size_t>()},
          values[9].cast<bool>()};
}

}  // namespace ocisac::bindings
