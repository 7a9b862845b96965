#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "frame_reader.hpp"

using namespace ocisac::apps;

namespace {

// Source that delivers the text.
ReadBytes source(const std::string& text) {
  return [text, at = std::size_t{0}](std::span<std::uint8_t> bytes) mutable {
    const std::size_t count = std::min(bytes.size(), text.size() - at);
    std::memcpy(bytes.data(), text.data() + at, count);
    at += count;
    return count;
  };
}

struct Read {
  std::vector<std::size_t> numbers;
  std::vector<std::string> frames, warnings;
  std::size_t torn = 0;
  std::optional<StreamHeader> header;
};

Read read_all(const std::string& text, std::optional<FrameLayout> raw = {}) {
  Read result;
  FrameReader reader(source(text), raw, [&](const std::string& what) { result.warnings.push_back(what); });
  while (const auto frame = reader.next()) {
    result.numbers.push_back(frame->number);
    result.frames.emplace_back(frame->bytes.begin(), frame->bytes.end());
  }
  result.torn = reader.torn();
  result.header = reader.header();
  return result;
}

std::string filled(std::size_t bytes, char with) { return std::string(bytes, with); }

}  // namespace

TEST_CASE("raw frames, the last one torn") {
  const auto layout = raw_layout(PixelFormat::gray8, 4, 3);
  const auto read = read_all(filled(12, 'a') + filled(12, 'b') + filled(5, 'c'), layout);
  CHECK(read.frames == std::vector<std::string>{filled(12, 'a'), filled(12, 'b')});
  CHECK(read.torn == 1);
  CHECK(read.warnings == std::vector<std::string>{"frame 2 is torn: 5 of 12 bytes; left out"});
  CHECK_THROWS_AS(read_all(filled(12, 'a')), std::invalid_argument);  // no size
  CHECK(!read_all("").header);
}

TEST_CASE("YUV4MPEG2 tells size, rate, bits and range itself") {
  const std::string head = "YUV4MPEG2 W4 H2 F30000:1001 Ip A1:1 C420mpeg2 XYSCSS=420MPEG2 XCOLORRANGE=LIMITED\n";
  const auto read = read_all(head + "FRAME\n" + filled(12, 'a') + "FRAME Ip\n" + filled(12, 'b'));
  REQUIRE(read.header);
  CHECK(read.header->layout.width == 4);
  CHECK(read.header->layout.height == 2);
  CHECK(read.header->layout.bytes == 12);
  CHECK(read.header->frame_rate.value_or(0) == doctest::Approx(29.97).epsilon(1e-4));
  CHECK(read.header->dark_level == 16);
  CHECK(read.header->white_level == 235);
  CHECK(read.frames == std::vector<std::string>{filled(12, 'a'), filled(12, 'b')});
  CHECK(read.torn == 0);
}

TEST_CASE("colour spaces of YUV4MPEG2") {
  struct Case {
    const char* colour;
    std::size_t bytes;
    PixelFormat format;
    double dark, white;
  };
  for (const Case& one : std::vector<Case>{{"mono", 15, PixelFormat::gray8, 0, 255},
                                           {"mono10", 30, PixelFormat::gray10le, 0, 1023},
                                           {"mono12", 30, PixelFormat::gray12le, 0, 4095},
                                           {"mono16", 30, PixelFormat::gray16le, 0, 65535},
                                           {"420jpeg", 27, PixelFormat::gray8, 16, 235},
                                           {"422", 33, PixelFormat::gray8, 16, 235},
                                           {"444", 45, PixelFormat::gray8, 16, 235},
                                           {"444alpha", 60, PixelFormat::gray8, 16, 235},
                                           {"411", 27, PixelFormat::gray8, 16, 235},
                                           {"420p10", 54, PixelFormat::gray10le, 64, 940}}) {
    CAPTURE(one.colour);
    const auto header = y4m_header("YUV4MPEG2 W5 H3 C" + std::string(one.colour) + "\n");
    REQUIRE(header);
    CHECK(header->layout.bytes == one.bytes);
    CHECK(header->layout.format == one.format);
    CHECK(header->dark_level == one.dark);
    CHECK(header->white_level == one.white);
  }
  CHECK(y4m_header("YUV4MPEG2 W5 H3 XCOLORRANGE=FULL\n")->white_level == 255);
  for (const char* bad : {"YUV4MPEG2 W5\n", "YUV4MPEG2 W0 H3\n", "YUV4MPEG2 W5 H3 Crgb\n", "YUV4MPEG2 W5 H3 Cmono20\n",
                          "YUV4MPEG2 W5x H3\n", "YUV4MPEG2 W5 H3 Cmono9999999999999999999999\n",
                          "YUV4MPEG2 W5 H3 Cmono9999999999\n", "YUV4MPEG2 W5 H3 C420p7\n", "YUV4MPEG2 W-5 H3\n",
                          "YUV4MPEG2 W32768 H32768 C444\n", "YUV4MPEG2 W23000 H23000 C444\n"})
    CHECK_THROWS_AS(y4m_header(bad), std::invalid_argument);
  CHECK(!y4m_header("YUV4MPEG2 W5 H3"));
}

TEST_CASE("a frame of YUV4MPEG2 that is cut short is left out, and the next is whole") {
  const std::string head = "YUV4MPEG2 W4 H3 Cmono\n";
  const auto frame = [](char with) { return "FRAME\n" + filled(12, with); };
  auto read = read_all(head + frame('a') + "FRAME\n" + filled(7, 'b') + frame('c') + frame('d'));
  CHECK(read.frames == std::vector<std::string>{filled(12, 'a'), filled(12, 'c'), filled(12, 'd')});
  CHECK(read.numbers == std::vector<std::size_t>{0, 2, 3});
  CHECK(read.warnings == std::vector<std::string>{"frame 1 is torn: 7 of 12 bytes; left out"});

  read = read_all(head + frame('a') + filled(100, 'x') + frame('b') + "FRA");
  CHECK(read.frames == std::vector<std::string>{filled(12, 'a'), filled(12, 'b')});
  CHECK(read.torn == 2);
}

TEST_CASE("a stream that ends within the marker of the next frame keeps what came") {
  const std::string head = "YUV4MPEG2 W4 H2 Cmono\n";
  for (const std::size_t pixels : {3U, 4U, 5U}) {
    for (const char* end : {"FRA", "FRAM", "FRAME"}) {
      CAPTURE(pixels);
      CAPTURE(end);
      const auto read = read_all(head + "FRAME\n" + filled(8, 'a') + "FRAME\n" + filled(pixels, 'b') + end);
      const bool whole = pixels + std::string(end).size() >= 8;
      CHECK(read.frames.size() == (whole ? 2 : 1));
      CHECK(read.torn <= 1);
    }
  }
  const auto cut = read_all(head + "FRAME\n" + filled(5, 'b') + "FRA");  // complete by length, nothing after it
  CHECK(cut.frames == std::vector<std::string>{"bbbbbFRA"});
}

TEST_CASE("pictures of fields are refused") {
  for (const char* marked : {"Ip", "I?"}) CHECK(y4m_header("YUV4MPEG2 W5 H4 " + std::string(marked) + "\n"));
  for (const char* marked : {"It", "Ib", "Im"})
    CHECK_THROWS_WITH_AS(y4m_header("YUV4MPEG2 W5 H4 " + std::string(marked) + "\n"),
                         doctest::Contains("separatefields"), std::invalid_argument);
}

TEST_CASE("a sequence of PGM pictures") {
  const std::string head = "P5\n# a comment\n4 3\n255\n";
  auto read =
      read_all(head + filled(12, 'a') + head + filled(12, 'b') + head + filled(4, 'c') + head + filled(12, 'd'));
  CHECK(read.frames == std::vector<std::string>{filled(12, 'a'), filled(12, 'b'), filled(12, 'd')});
  CHECK(read.torn == 1);

  read = read_all("P5 4 3 1023 " + filled(24, 'e'));
  REQUIRE(read.header);
  CHECK(read.header->layout.format == PixelFormat::gray16be);
  CHECK(read.header->white_level == 1023);
  CHECK(read.frames.size() == 1);
  for (const char* bad : {"P5 4 3 0 x", "P5 4 3 65536 x", "P5 0 3 255 x", "P5 4 a 255 x"})
    CHECK_THROWS_AS(pgm_header(bad), std::invalid_argument);
  CHECK_THROWS_AS(read_all("P5 4"), std::invalid_argument);
}
