// Samples of 10 and 12 bits packed as MIPI CSI-2 does.
#pragma once

#include <cstddef>
#include <cstdint>

namespace ocisac {

// RAW10: four samples in five bytes, the low bits of all four in the last. RAW12: two samples in three bytes, the low
// bits of both in the last.
enum class Packing { raw10, raw12 };

// Samples first … first + count − 1 of a row that begins at `row`; no byte behind their groups is read.
void unpack_samples(Packing packing, const std::uint8_t* row, std::size_t first, std::size_t count, std::uint16_t* to);

}  // namespace ocisac
