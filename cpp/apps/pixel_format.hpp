// Memory layout of raw frames and their grey picture.
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
  gray10le,  // 16 bits a pixel, little-endian, like the next two
  gray12le,
  gray16le,
  gray16be,
  gray10p,  // MIPI CSI-2 RAW10: four pixels in five bytes, the low bits of all four in the last
  gray12p,  // MIPI CSI-2 RAW12: two pixels in three bytes, the low bits of both in the last
  yuv420p,  // planes of luma and of twice a quarter of chroma, which is ignored
  nv12,
  yuyv,  // luma in every second byte
};

// Format with this name on the command line; absent for an unknown name.
std::optional<PixelFormat> pixel_format(std::string_view name);
std::string_view pixel_format_name(PixelFormat format);
std::vector<PixelFormat> pixel_formats();
// All names, separated by commas.
std::string_view pixel_format_names();

// Bytes of a raw frame without padding.
std::size_t dense_bytes(PixelFormat format, std::size_t width, std::size_t height);

// Largest value of a pixel: 255, 1023, 4095 or 65535.
double largest_value(PixelFormat format);

// Memory layout of the rows of a frame.
struct FrameLayout {
  PixelFormat format = PixelFormat::gray8;
  std::size_t width = 0, height = 0;
  std::size_t stride = 0;  // bytes from row to row of the luma
  std::size_t bytes = 0;   // size of a frame
};

// Throws std::invalid_argument for frames of more than 2^30 bytes.
void check_size(const FrameLayout& layout);

// Layout of a raw frame; `stride`: bytes from row to row, 0 for dense rows (else that of luma; chroma's is half of it).
FrameLayout raw_layout(PixelFormat format, std::size_t width, std::size_t height, std::size_t stride = 0);

// The grey picture of a frame: a view of the frame where its pixels are plain numbers, else of an unpacked copy.
class GrayPicture {
 public:
  explicit GrayPicture(const FrameLayout& layout);

  // `frame`: `layout.bytes` bytes that outlive the view. Pixels outside of `region` (stored pixels) are undefined.
  AnyFramesView view(std::span<const std::uint8_t> frame, const Region& region);

 private:
  FrameLayout layout_;
  std::vector<std::uint16_t> unpacked_;
};

}  // namespace ocisac::apps
