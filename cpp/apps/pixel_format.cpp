#include "pixel_format.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <string>
#include <utility>

#include "ocisac/camera/packed_samples.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac::apps {

namespace {

static_assert(std::endian::native == std::endian::little, "little-endian samples are read as they lie in memory");

constexpr std::size_t kMaxFrame = std::size_t{1} << 30;  // bytes

constexpr std::array<std::pair<std::string_view, PixelFormat>, 10> kNames{{{"gray8", PixelFormat::gray8},
                                                                           {"gray10le", PixelFormat::gray10le},
                                                                           {"gray12le", PixelFormat::gray12le},
                                                                           {"gray16le", PixelFormat::gray16le},
                                                                           {"gray16be", PixelFormat::gray16be},
                                                                           {"gray10p", PixelFormat::gray10p},
                                                                           {"gray12p", PixelFormat::gray12p},
                                                                           {"yuv420p", PixelFormat::yuv420p},
                                                                           {"nv12", PixelFormat::nv12},
                                                                           {"yuyv", PixelFormat::yuyv}}};

std::size_t row_bytes(PixelFormat format, std::size_t width) {
  switch (format) {
    case PixelFormat::gray10le:
    case PixelFormat::gray12le:
    case PixelFormat::gray16le:
    case PixelFormat::gray16be:
    case PixelFormat::yuyv: return 2 * width;
    case PixelFormat::gray10p: return (width + 3) / 4 * 5;
    case PixelFormat::gray12p: return (width + 1) / 2 * 3;
    default: return width;
  }
}

// Size of both chroma planes in bytes, each of half the rows.
std::size_t chroma_bytes(PixelFormat format, std::size_t height, std::size_t stride) {
  const bool planes = format == PixelFormat::yuv420p || format == PixelFormat::nv12;
  return planes ? (height + 1) / 2 * ((stride + 1) / 2) * 2 : 0;
}

bool is_unpacked(PixelFormat format) {
  return format == PixelFormat::gray10p || format == PixelFormat::gray12p || format == PixelFormat::gray16be;
}

// Pixels of a row from `first` on.
void unpack(PixelFormat format, const std::uint8_t* row, std::size_t first, std::size_t count, std::uint16_t* out) {
  if (format != PixelFormat::gray16be)
    return unpack_samples(format == PixelFormat::gray10p ? Packing::raw10 : Packing::raw12, row, first, count, out);
  row += 2 * first;
  for (std::size_t i = 0; i < count; ++i) out[i] = static_cast<std::uint16_t>(row[2 * i] << 8 | row[2 * i + 1]);
}

template <class T>
AnyFramesView strided(const std::uint8_t* data, const FrameLayout& layout, std::ptrdiff_t column_stride) {
  const auto stride = static_cast<std::ptrdiff_t>(layout.stride / sizeof(T));
  return FramesView<const T>{
      reinterpret_cast<const T*>(data), 1, layout.height, layout.width, 0, stride, column_stride};
}

}  // namespace

std::optional<PixelFormat> pixel_format(std::string_view name) {
  for (const auto& [known, format] : kNames)
    if (known == name) return format;
  return std::nullopt;
}

std::string_view pixel_format_name(PixelFormat format) {
  return std::find_if(kNames.begin(), kNames.end(), [&](const auto& named) { return named.second == format; })->first;
}

std::vector<PixelFormat> pixel_formats() {
  std::vector<PixelFormat> formats;
  for (const auto& [name, format] : kNames) formats.push_back(format);
  return formats;
}

std::size_t dense_bytes(PixelFormat format, std::size_t width, std::size_t height) {
  const std::size_t row = row_bytes(format, width);
  return row * height + chroma_bytes(format, height, row);
}

std::string_view pixel_format_names() {
  static const std::string names = [] {
    std::string all;
    for (const auto& [name, format] : kNames) all += (all.empty() ? "" : ", ") + std::string(name);
    return all;
  }();
  return names;
}

double largest_value(PixelFormat format) {
  switch (format) {
    case PixelFormat::gray10le:
    case PixelFormat::gray10p: return 1023;
    case PixelFormat::gray12le:
    case PixelFormat::gray12p: return 4095;
    case PixelFormat::gray16le:
    case PixelFormat::gray16be: return 65535;
    default: return 255;
  }
}

FrameLayout raw_layout(PixelFormat format, std::size_t width, std::size_t height, std::size_t stride) {
  const std::size_t dense = row_bytes(format, width);
  const bool wide = format != PixelFormat::gray8 && largest_value(format) > 255 && !is_unpacked(format);
  require(stride == 0 || (stride >= dense && stride <= kMaxFrame && (!wide || stride % 2 == 0)), "--stride", stride,
          "at least the " + std::to_string(dense) + " bytes of a row, and whole pixels");
  FrameLayout layout{format, width, height, stride == 0 ? dense : stride, 0};
  layout.bytes = layout.stride * height + chroma_bytes(format, height, layout.stride);
  check_size(layout);
  return layout;
}

void check_size(const FrameLayout& layout) {
  require(layout.bytes <= kMaxFrame, "frame", std::to_string(layout.bytes) + " bytes", "frames of at most 2^30 bytes");
}

GrayPicture::GrayPicture(const FrameLayout& layout) : layout_(layout) {}

AnyFramesView GrayPicture::view(std::span<const std::uint8_t> frame, const Region& region) {
  require(frame.size() >= layout_.bytes, "frame", frame.size(), std::to_string(layout_.bytes) + " bytes");
  if (is_unpacked(layout_.format)) {
    unpacked_.resize(layout_.width * layout_.height);  // allocated with the first frame: a header alone uses no memory
    for (std::size_t y = region.y; y < region.y + region.height; ++y)
      unpack(layout_.format, frame.data() + y * layout_.stride, region.x, region.width,
             unpacked_.data() + y * layout_.width + region.x);
    return dense_view<const std::uint16_t>(unpacked_.data(), 1, layout_.height, layout_.width);
  }
  if (layout_.format == PixelFormat::yuyv) return strided<std::uint8_t>(frame.data(), layout_, 2);
  if (largest_value(layout_.format) > 255) return strided<std::uint16_t>(frame.data(), layout_, 1);
  return strided<std::uint8_t>(frame.data(), layout_, 1);
}

}  // namespace ocisac::apps
