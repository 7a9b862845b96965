#include "json_line.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>

namespace ocisac::apps {

namespace {

void append_number(std::string& text, auto value) {
  std::array<char, 32> digits{};
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
  text.append(digits.data(), end);
}

// Bytes of the UTF-8 sequence that `text` begins with; 0 where it begins with none (RFC 3629).
std::size_t sequence_length(std::string_view text) {
  const auto byte = [&](std::size_t k) -> unsigned {
    return k < text.size() ? static_cast<unsigned char>(text[k]) : 0U;
  };
  const auto follows = [&](std::size_t k, unsigned low, unsigned high) { return byte(k) >= low && byte(k) <= high; };
  const unsigned lead = byte(0);
  if (lead < 0x80) return 1;
  if (lead >= 0xC2 && lead <= 0xDF) return follows(1, 0x80, 0xBF) ? 2 : 0;
  if (lead >= 0xE0 && lead <= 0xEF) {
    const unsigned low = lead == 0xE0 ? 0xA0 : 0x80, high = lead == 0xED ? 0x9F : 0xBF;
    return follows(1, low, high) && follows(2, 0x80, 0xBF) ? 3 : 0;
  }
  if (lead >= 0xF0 && lead <= 0xF4) {
    const unsigned low = lead == 0xF0 ? 0x90 : 0x80, high = lead == 0xF4 ? 0x8F : 0xBF;
    return follows(1, low, high) && follows(2, 0x80, 0xBF) && follows(3, 0x80, 0xBF) ? 4 : 0;
  }
  return 0;
}

}  // namespace

void JsonLine::comma() {
  if (!first_) text_ += ',';
  first_ = false;
}

void JsonLine::name(std::string_view name) {
  comma();
  text_ += '"';
  text_ += name;
  text_ += "\":";
}

void JsonLine::open(std::string_view of) {
  name(of);
  text_ += '{';
  first_ = true;
}

void JsonLine::close() {
  text_ += '}';
  first_ = false;
}

void JsonLine::open_list(std::string_view of) {
  name(of);
  text_ += '[';
  first_ = true;
}

void JsonLine::close_list() {
  text_ += ']';
  first_ = false;
}

void JsonLine::member(std::string_view of, double value) {
  name(of);
  if (std::isfinite(value))
    append_number(text_, value);
  else
    text_ += "null";
}

void JsonLine::member(std::string_view of, bool value) {
  name(of);
  text_ += value ? "true" : "false";
}

void JsonLine::member(std::string_view of, std::string_view value) {
  name(of);
  quoted(value);
}

void JsonLine::whole(std::string_view of, std::int64_t value) {
  name(of);
  append_number(text_, value);
}

void JsonLine::item(std::string_view value) {
  comma();
  quoted(value);
}

void JsonLine::item(std::int64_t value) {
  comma();
  append_number(text_, value);
}

void JsonLine::quoted(std::string_view value) {
  text_ += '"';
  while (!value.empty()) {
    const std::size_t length = sequence_length(value);
    const auto byte = static_cast<unsigned char>(value.front());
    if (length == 0) {
      text_ += "\\ufffd";
    } else if (byte < 0x20) {
      std::array<char, 7> escape{};
      std::snprintf(escape.data(), escape.size(), "\\u%04x", byte);
      text_ += escape.data();
    } else {
      if (byte == '"' || byte == '\\') text_ += '\\';
      text_ += value.substr(0, length);
    }
    value.remove_prefix(length == 0 ? 1 : length);
  }
  text_ += '"';
}

void JsonLine::base64(std::string_view of, std::span<const std::uint8_t> bytes) {
  static constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  name(of);
  text_ += '"';
  for (std::size_t k = 0; k < bytes.size(); k += 3) {
    const auto byte = [&](std::size_t at) { return at < bytes.size() ? std::uint32_t{bytes[at]} : 0U; };
    const std::uint32_t group = byte(k) << 16 | byte(k + 1) << 8 | byte(k + 2);
    for (std::size_t digit = 0; digit < 4; ++digit)
      text_ += k + digit <= bytes.size() ? kDigits[group >> (18 - 6 * digit) & 63] : '=';
  }
  text_ += '"';
}

}  // namespace ocisac::apps
