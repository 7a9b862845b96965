// Headers of self-describing streams: YUV4MPEG2 and PGM.
#pragma once

#include <cstddef>
#include <optional>
#include <string_view>

#include "pixel_format.hpp"

namespace ocisac::apps {

// Contents of a header. `layout.bytes` counts all planes of a frame, without headers.
struct StreamHeader {
  FrameLayout layout;
  double white_level = 255;  // DN of full light
  double dark_level = 0;     // DN without light
  std::optional<double> frame_rate;
  std::size_t bytes = 0;  // size of the header
};

inline constexpr std::string_view kY4mMagic = "YUV4MPEG2 ", kY4mFrame = "FRAME";
inline constexpr std::size_t kLongestHeader = 4096;  // bytes
inline constexpr std::size_t kMaxSide = 99999;       // pixels

// Decimal digits only, without sign or space; absent for any other text and for numbers above 2^64 - 1.
std::optional<std::size_t> whole_number(std::string_view text);

// First line of a YUV4MPEG2 stream; absent while it is incomplete. Throws std::invalid_argument for invalid values and
// for colour spaces without a luma plane. Luma has limited range unless the header specifies full range; grey without
// chroma has full range.
std::optional<StreamHeader> y4m_header(std::string_view text);

// Header of one binary PGM picture, likewise. It begins with "P5" and white space.
std::optional<StreamHeader> pgm_header(std::string_view text);
bool begins_pgm(std::string_view text);

}  // namespace ocisac::apps
