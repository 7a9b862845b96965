#include <doctest/doctest.h>

#include <cstdint>
#include <stdexcept>
#include <vector>

#include "ocisac/camera/linear_light.hpp"
#include "ocisac/core/scan_axis.hpp"
#include "pixel_format.hpp"

using namespace ocisac;
using namespace ocisac::apps;

namespace {

// Pixel value of `bits` bits that differs between positions.
unsigned pixel(std::size_t row, std::size_t column, unsigned bits) {
  return static_cast<unsigned>((row * 641 + column * 37 + 5) * 2654435761U >> 7) & ((1U << bits) - 1);
}

double at(const ocisac::AnyFramesView& view, std::size_t row, std::size_t column) {
  return std::visit([&](const auto& typed) { return static_cast<double>(typed(0, row, column)); }, view);
}

// A frame packed by the formats' definitions, one pixel at a time, with noise in all bytes other than luma.
std::vector<std::uint8_t> packed(const FrameLayout& layout, unsigned bits) {
  std::vector<std::uint8_t> bytes(layout.bytes, 0xA5);
  for (std::size_t row = 0; row < layout.height; ++row)
    for (std::size_t column = 0; column < layout.width; ++column) {
      const unsigned value = pixel(row, column, bits);
      std::uint8_t* line = bytes.data() + row * layout.stride;
      const auto low = static_cast<std::uint8_t>(value), high = static_cast<std::uint8_t>(value >> 8);
      switch (layout.format) {
        case PixelFormat::gray10p: {
          std::uint8_t* group = line + column / 4 * 5;
          const unsigned shift = 2 * (column % 4);
          group[column % 4] = static_cast<std::uint8_t>(value >> 2);
          group[4] = static_cast<std::uint8_t>((group[4] & ~(3U << shift)) | (value & 3U) << shift);
          break;
        }
        case PixelFormat::gray12p: {
          std::uint8_t* group = line + column / 2 * 3;
          const unsigned shift = 4 * (column % 2);
          group[column % 2] = static_cast<std::uint8_t>(value >> 4);
          group[2] = static_cast<std::uint8_t>((group[2] & ~(15U << shift)) | (value & 15U) << shift);
          break;
        }
        case PixelFormat::gray16be: line[2 * column] = high, line[2 * column + 1] = low; break;
        case PixelFormat::yuyv: line[2 * column] = low; break;
        default:
          if (bits == 8) {
            line[column] = low;
          } else {
            line[2 * column] = low, line[2 * column + 1] = high;
          }
      }
    }
  return bytes;
}

}  // namespace

TEST_CASE("the luma of every format is found, with and without padded rows") {
  struct Case {
    const char* name;
    unsigned bits;
    std::size_t width, height, bytes, padded;
  };
  const std::vector<Case> cases{
      {"gray8", 8, 13, 7, 91, 16},      {"gray10le", 10, 13, 7, 182, 32},  {"gray12le", 12, 13, 7, 182, 32},
      {"gray16le", 16, 13, 7, 182, 32}, {"gray16be", 16, 13, 7, 182, 32},  {"gray10p", 10, 13, 7, 140, 32},
      {"gray12p", 12, 13, 7, 147, 32},  {"yuv420p", 8, 12, 8, 144, 16},    {"nv12", 8, 12, 8, 144, 16},
      {"yuyv", 8, 12, 8, 192, 32},      {"yuv420p", 8, 13, 7, 91 + 56, 0}, {"gray10p", 10, 4, 1, 5, 0}};
  for (const auto& one : cases)
    for (const std::size_t stride : {std::size_t{0}, one.padded}) {
      CAPTURE(one.name);
      CAPTURE(stride);
      const auto format = pixel_format(one.name);
      REQUIRE(format);
      const auto layout = raw_layout(*format, one.width, one.height, stride);
      if (stride == 0) CHECK(layout.bytes == one.bytes);
      CHECK(largest_value(*format) == (1 << one.bits) - 1);
      const auto bytes = packed(layout, one.bits);
      GrayPicture picture(layout);
      const auto view = picture.view(bytes, {0, 0, one.width, one.height});
      CHECK(ocisac::shape_of(view).rows == one.height);
      CHECK(ocisac::shape_of(view).columns == one.width);
      int wrong = 0;
      for (std::size_t row = 0; row < one.height; ++row)
        for (std::size_t column = 0; column < one.width; ++column)
          wrong += at(view, row, column) != pixel(row, column, one.bits);
      CHECK(wrong == 0);
    }
}

TEST_CASE("layouts without meaning are refused") {
  CHECK(!pixel_format("rgb24"));
  CHECK_THROWS_AS(raw_layout(PixelFormat::gray8, 10, 4, 9), std::invalid_argument);
  CHECK_THROWS_AS(raw_layout(PixelFormat::gray16le, 10, 4, 21), std::invalid_argument);
  CHECK_THROWS_AS(raw_layout(PixelFormat::gray8, 99999, 99999), std::invalid_argument);
}

TEST_CASE("scan axes turn the picture so that rows are in time order, and boxes back") {
  const auto layout = raw_layout(PixelFormat::gray8, 5, 3);
  const auto bytes = packed(layout, 8);
  GrayPicture picture(layout);
  const auto stored = picture.view(bytes, {0, 0, 5, 3});
  const ocisac::Region region{1, 0, 3, 2};
  for (const auto axis : {ScanAxis::down, ScanAxis::up, ScanAxis::right, ScanAxis::left}) {
    const auto view = in_time_order(stored, axis);
    const auto box = to_time_order(region, axis, 5, 3);
    CHECK(to_stored(box, axis, 5, 3) == region);
    double in_region = 0, in_box = 0;
    for (std::size_t y = 0; y < region.height; ++y)
      for (std::size_t x = 0; x < region.width; ++x) in_region += at(stored, region.y + y, region.x + x);
    for (std::size_t y = 0; y < box.height; ++y)
      for (std::size_t x = 0; x < box.width; ++x) in_box += at(view, box.y + y, box.x + x);
    CHECK(in_box == in_region);
  }
  CHECK(at(in_time_order(stored, ScanAxis::up), 0, 1) == at(stored, 2, 1));
  CHECK(at(in_time_order(stored, ScanAxis::right), 4, 1) == at(stored, 1, 4));
  CHECK(at(in_time_order(stored, ScanAxis::left), 0, 1) == at(stored, 1, 4));
}
