#include "stream_header.hpp"

#include <array>
#include <charconv>
#include <string>

#include "ocisac/core/require.hpp"

namespace ocisac::apps {

namespace {

std::size_t side(std::string_view what, std::string_view text) {
  const auto value = whole_number(text);
  require(value && *value >= 1 && *value <= kMaxSide, what, text, "pixels, 1 to 99999");
  return *value;
}

// A colour space of YUV4MPEG2, identified by the `prefix` of its name; the size of its chroma planes relative to luma.
struct ColourSpace {
  std::string_view prefix;
  std::size_t planes, across, down;  // chroma: planes × ceil(width / across) × ceil(height / down)
};
constexpr std::array<ColourSpace, 6> kColourSpaces{
    {{"mono", 0, 1, 1}, {"444alpha", 3, 1, 1}, {"420", 2, 2, 2}, {"422", 2, 2, 1}, {"444", 2, 1, 1}, {"411", 2, 4, 1}}};

// Bits per sample: 8 unless the name ends in another number (mono10, 420p12).
std::size_t bits_of(std::string_view name, std::string_view prefix) {
  std::string_view rest = name.substr(prefix.size());
  if (!rest.empty() && rest.front() == 'p') rest.remove_prefix(1);
  if (rest.empty() || rest.find_first_not_of("0123456789") != rest.npos) return 8;
  const auto bits = whole_number(rest);
  require(bits && *bits >= 8 && *bits <= 16, "YUV4MPEG2 colour space", name, "samples of 8 to 16 bits");
  return *bits;
}

PixelFormat format_of_bits(std::size_t bits) {
  if (bits == 8) return PixelFormat::gray8;
  if (bits == 10) return PixelFormat::gray10le;
  return bits == 12 ? PixelFormat::gray12le : PixelFormat::gray16le;
}

std::optional<double> ratio(std::string_view text) {
  const auto colon = text.find(':');
  if (colon == std::string_view::npos) return std::nullopt;
  const auto above = whole_number(text.substr(0, colon)), below = whole_number(text.substr(colon + 1));
  if (!above || !below || *above == 0 || *below == 0) return std::nullopt;
  return static_cast<double>(*above) / static_cast<double>(*below);
}

void set_colour_space(StreamHeader& header, std::string_view colour, bool full_range) {
  const std::size_t width = header.layout.width, height = header.layout.height;
  for (const auto& space : kColourSpaces) {
    if (!colour.starts_with(space.prefix)) continue;
    const std::size_t bits = bits_of(colour, space.prefix);
    header.layout = raw_layout(format_of_bits(bits), width, height);
    const std::size_t across = (width + space.across - 1) / space.across;
    const std::size_t down = (height + space.down - 1) / space.down;
    header.layout.bytes += space.planes * across * down * (bits > 8 ? 2 : 1);
    check_size(header.layout);
    const auto scale = static_cast<double>(std::size_t{1} << (bits - 8));
    header.white_level = full_range ? 256 * scale - 1 : 235 * scale;
    header.dark_level = full_range ? 0 : 16 * scale;
    return;
  }
  refuse("YUV4MPEG2 colour space", colour, "mono, 420, 422, 444 or 411 with any ending");
}

// Interlaced pictures are rejected: a field has every second row, and a picture has rows of two times.
void require_progressive(std::string_view interlacing) {
  require(interlacing == "p" || interlacing == "?" || interlacing.empty(), "YUV4MPEG2 interlacing", interlacing,
          "p: progressive pictures (ffmpeg -vf separatefields: each field a picture of twice the row time; "
          "-vf setfield=prog: where the mark is wrong)");
}

}  // namespace

std::optional<std::size_t> whole_number(std::string_view text) {
  std::size_t value = 0;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (problem != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

std::optional<StreamHeader> y4m_header(std::string_view text) {
  const auto end = text.find('\n');
  if (end == std::string_view::npos) {
    require(text.size() < kLongestHeader, "YUV4MPEG2 header", text.size(), "a line of less than 4096 bytes");
    return std::nullopt;
  }
  StreamHeader header;
  header.bytes = end + 1;
  std::string_view colour = "420jpeg";
  std::string_view range;
  std::string_view line = text.substr(0, end);
  while (!line.empty()) {
    const auto space = line.find(' ');
    const std::string_view token = line.substr(0, space);
    line = space == std::string_view::npos ? std::string_view{} : line.substr(space + 1);
    if (token.starts_with('W')) header.layout.width = side("YUV4MPEG2 width", token.substr(1));
    if (token.starts_with('H')) header.layout.height = side("YUV4MPEG2 height", token.substr(1));
    if (token.starts_with('F')) header.frame_rate = ratio(token.substr(1));
    if (token.starts_with('I')) require_progressive(token.substr(1));
    if (token.starts_with('C')) colour = token.substr(1);
    if (token.starts_with("XCOLORRANGE=")) range = token.substr(12);
  }
  require(header.layout.width > 0 && header.layout.height > 0, "YUV4MPEG2 header", text.substr(0, end),
          "a width and a height");
  set_colour_space(header, colour, range.empty() ? colour.starts_with("mono") : range == "FULL");
  return header;
}

bool begins_pgm(std::string_view text) {
  return text.size() >= 3 && text.starts_with("P5") && std::string_view(" \t\n\r#").find(text[2]) != text.npos;
}

// "P5", then width, height and maximum between white space and comments, then one white space.
std::optional<StreamHeader> pgm_header(std::string_view text) {
  std::array<std::string_view, 3> numbers;
  std::size_t at = 2, found = 0;
  while (found < numbers.size() && at < text.size()) {
    const auto begin = text.find_first_not_of(" \t\n\r", at);
    if (begin == text.npos) break;
    const bool comment = text[begin] == '#';
    at = text.find_first_of(comment ? "\n" : " \t\n\r", begin);
    if (at == text.npos) break;
    if (!comment) numbers[found++] = text.substr(begin, at - begin);
  }
  if (found < numbers.size() || at >= text.size()) {
    require(text.size() < kLongestHeader, "PGM header", text.size(), "less than 4096 bytes");
    return std::nullopt;
  }
  const auto largest = whole_number(numbers[2]);
  require(largest && *largest >= 1 && *largest <= 65535, "PGM largest value", numbers[2], "1 to 65535");
  const auto format = *largest > 255 ? PixelFormat::gray16be : PixelFormat::gray8;
  StreamHeader header;
  header.layout = raw_layout(format, side("PGM width", numbers[0]), side("PGM height", numbers[1]));
  header.white_level = static_cast<double>(*largest);
  header.bytes = at + 1;
  return header;
}

}  // namespace ocisac::apps
