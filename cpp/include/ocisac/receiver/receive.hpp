// From frames to bits.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/chips/detector.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

struct ReceiveOptions {
  std::optional<double> chip_rate;  // Hz; searched within 3 % of it. Absent: found blind, 2 to 64 rows a chip
};

// One source in one frame. Where it cannot be decoded, `bits` is empty, times are NaN and `flags` say why.
struct Received {
  std::size_t frame = 0;
  std::size_t source = 0;
  std::size_t colour = 0;       // index of the colour that was read
  std::string bits;             // '0' and '1' in time order, 1 = bright; chips cut by the frame's edges left out
  double rows_per_chip;         // rows
  double rows_per_chip_std;     // rows, standard error
  double phase;                 // row at which the first whole chip begins: the middle of its edge's ramp
  double snr = 0;               // (half the swing)² / variance of the chips about their levels; at most 1e12
  Detection detection;          // levels and soft values
  std::vector<double> weights;  // (columns), sum 1; 0: left out
  Flags flags = 0;
};

// The sources in each frame, at least one result a frame, the strongest source first. `colours`: one view a
// colour, all of one shape; the one in which the light stands out most is read. Several sources are told apart where
// they stand side by side (light_groups); further ones are given where they are decoded without a doubt. Frames are
// decoded by themselves.
std::vector<Received> receive(std::span<const AnyFramesView> colours, const Camera& camera,
                              const ReceiveOptions& options = {});

// Length of a chip in rows, as `receive` finds it in a signal; absent where it decodes nothing.
std::optional<double> blind_rows_per_chip(const CombinedColumn& column, const Camera& camera);

}  // namespace ocisac
