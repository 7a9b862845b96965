// Parts of one light told from lights beside each other: what lies between parts of one light swings as they do.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/core/views.hpp"

namespace ocisac {

// Box of a light in a frame, and its cycles per row.
struct LightPart {
  std::size_t column, row, width, height;
  double frequency;
};

// Whether parts beside each other are of one light: log light, less its mean over two cycles, swings alike (correlation
// 0.8) in the rows of both, and in the columns between. Parts farther apart than they are wide are not looked at.
// `dark`: DN of no light; `floor`: of the logarithm, DN.
bool one_light_across(const AnyFramesView& frames, std::size_t frame, double dark, double floor, const LightPart& a,
                      const LightPart& b);

// The same of parts above each other, in much the same columns: the rows between, at least a cycle, swing alike in the
// left and the right half (0.9), and at least 0.7 times as far as the parts. A tone would have been found as a whole:
// such a light sends data. Parts farther apart than they are high together are not looked at.
bool one_light_down(const AnyFramesView& frames, std::size_t frame, double dark, double floor, const LightPart& a,
                    const LightPart& b);

// Lamps that touch, found as one: runs of columns whose log light swings unlike (correlation below 0.5) that of the run
// before, each at least a fifth of the box, and the strongest frequency in each between half and twice the box's.
// Nothing where the outer quarters swing alike, or fewer than two runs are wide enough.
std::vector<LightPart> parts_beside(const AnyFramesView& frames, std::size_t frame, double dark, double floor,
                                    const LightPart& box);

}  // namespace ocisac
