// Streams of chips that the colours of one lamp send: as many as differ.
#pragma once

#include <cstddef>
#include <vector>

#include "ocisac/columns/column_combination.hpp"
#include "ocisac/receiver/light_receiver.hpp"

namespace ocisac {

inline constexpr std::size_t kMinChipsOfStreams = 16;  // by which streams are separated

// Model: v = A·s + b + noise, v (colours) of each chip, s one or several streams of −1 and 1, A the mixing of the
// lamp's colours by those of the camera. Streams start as the colours' own decisions, those that agree or are opposite
// as one; A and s are then fitted in turns (least squares, and the nearest of all combinations of bits). Colours that
// show one stream alone are added with the weights of the best signal-to-noise ratio, those with its opposite apart.
// `values`: (colours × chips) light of each chip. Empty where a colour has no two levels.
std::vector<ColourStream> colour_streams(const std::vector<std::vector<double>>& values);

// The weighted sum of the colours, with the columns of the one that shows the stream best.
CombinedColumn sum_of(const std::vector<CombinedColumn>& columns, const ColourStream& stream);

}  // namespace ocisac
