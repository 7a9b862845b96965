// How the pixels of a raw frame lie in memory, and the grey picture in it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "ocisac/core/views.hpp"

namespace ocisac::apps {

enum class PixelFormat {
  gray8,
  gray10le,  // 16 bits a pixel, little-endian, as the next two
  gray12le,
  gray16le,
  gray16be,
  gray10p,  // MIPI CSI-2 RAW10: four pixels in five bytes, the low bits of all four in the last
  gray12p,  // MIPI CSI-2 RAW12: two pixels in three bytes, the low bits of both in the last
  yuv420p,  // planes of luma and twice a quarter of chroma, which are left alone
  nv12,
  yuyv,  // luma in every second byte
};

// Its name on the command line; nothing for a name that is none.
std::optional<PixelFormat> pixel_format(std::string_view name);
// All names with commas.
std::string_view pixel_format_names();

// Largest value of a pixel: 255, 1023, 4095 or 65535.
double largest_value(PixelFormat format);

// Where the rows of a frame lie.
struct FrameLayout {
  PixelFormat format = PixelFormat::gray8;
  std::size_t width = 0, height = 0;
  std::size_t stride = 0;  // bytes from row to row of the luma
  std::size_t bytes = 0;   // of a whole frame
};

// Refused (std::invalid_argument): frames of more than 2^30 bytes.
void check_size(const FrameLayout& layout);

// A raw frame; `stride`: bytes from row to row, 0 where rows are dense (else of every plane; chroma's is half of it).
FrameLayout raw_layout(PixelFormat format, std::size_t width, std::size_t height, std::size_t stride = 0);

// Part of a picture, in stored pixels.
struct StoredRegion {
  std::size_t x = 0, y = 0, width = 0, height = 0;
  bool operator==(const StoredRegion&) const = default;
};

// The grey picture of a frame: a view of the frame itself where its pixels lie as numbers, else of what is unpacked.
class GrayPicture {
 public:
  explicit GrayPicture(const FrameLayout& layout);

  // Of `layout.bytes` bytes, which must stay; of the pixels outside of `region` no value is promised.
  AnyFramesView view(std::span<const std::uint8_t> frame, const StoredRegion& region);

 private:
  FrameLayout layout_;
  std::vector<std::uint16_t> unpacked_;
};

}  // namespace ocisac::apps
