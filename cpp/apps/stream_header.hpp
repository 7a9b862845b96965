// Headers of the streams that say themselves what they hold: YUV4MPEG2 and PGM.
#pragma once

#include <cstddef>
#include <optional>
#include <string_view>

#include "pixel_format.hpp"

namespace ocisac::apps {

// What a header tells. `layout.bytes` counts all planes of a frame, without headers.
struct StreamHeader {
  FrameLayout layout;
  double white_level = 255;  // DN of full light
  double dark_level = 0;     // DN of no light
  std::optional<double> frame_rate;
  std::size_t bytes = 0;  // of the header itself
};

inline constexpr std::string_view kY4mMagic = "YUV4MPEG2 ", kY4mFrame = "FRAME";
inline constexpr std::size_t kLongestHeader = 4096;  // bytes
inline constexpr std::size_t kMaxSide = 99999;       // pixels

// Decimal digits alone, without sign or space; nothing for any other text, or a number beyond 2^64 - 1.
std::optional<std::size_t> whole_number(std::string_view text);

// The line that begins a YUV4MPEG2 stream, nothing while it is not whole. Refused (std::invalid_argument): what it says
// has no meaning, or is a colour space without a plane of luma. Luma that is not said to be full is of limited range,
// as YUV is by convention; grey alone is full.
std::optional<StreamHeader> y4m_header(std::string_view text);

// The header of one binary PGM picture, likewise. It begins with "P5" and white space.
std::optional<StreamHeader> pgm_header(std::string_view text);
bool begins_pgm(std::string_view text);

}  // namespace ocisac::apps
