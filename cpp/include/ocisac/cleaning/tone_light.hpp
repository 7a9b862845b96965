// The light of the rows of a banded picture as a tone with harmonics.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/cleaning/column_bundles.hpp"

namespace ocisac {

struct ToneLight {
  std::vector<double> light;  // of each row: mean 1, the darkest one 0
  double frequency = 0;       // cycles per row
  std::size_t harmonics = 1;
  double second = 0;  // cycles per row of the sine of a second lamp; 0: none
};

// Mean, harmonics and slow terms are fitted to the rows at the frequency found in them; none if they do not explain
// `enough` of the rows' swing (no bound where it is empty). Periodic texture contributes to the rows too. It has few
// edges, so the tone is then fitted to the picture itself, with harmonics or the sine of a second lamp where
// they are much likelier.
// rows: (rows) estimated without a model (ColumnBundles::free), with their information.
std::optional<ToneLight> find_tone_light(const ColumnBundles& picture, const RowLight& rows,
                                         std::optional<double> enough);

// The tone fitted to the picture from `light`, of any phase; its frequencies, one Gauss–Newton step from those of
// `tone`.
ToneLight refined_tone_light(const ColumnBundles& picture, std::span<const double> light, ToneLight tone);

}  // namespace ocisac
