// The light of the rows of a banded picture as chips: on or off, with one response.
#pragma once

#include <optional>

#include "ocisac/cleaning/row_model.hpp"

namespace ocisac {

// Refines rows estimated without a model (ColumnBundles::free) with chips; none if chips do not explain 92 % of them,
// unless `always`. Rows drift, since the picture contributes to their slow changes: chips are detected without these,
// and their response is then fitted to the differences of neighbouring rows of the picture.
std::optional<ModelledLight> find_chip_light(const ColumnBundles& picture, const RowLight& rows, bool always);

// Share of the rows' swing, about the line through the tops of bright runs, that chips of one response leave
// unexplained; 1 without chips. Chips are additive in linear light only: a wrong tone curve increases it.
double unexplained_by_chips(const RowLight& rows);

}  // namespace ocisac
