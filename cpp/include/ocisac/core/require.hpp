// Checks of arguments: one line that names the argument, its value and what is allowed.
#pragma once

#include <array>
#include <charconv>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>

namespace ocisac {

// The shortest text that reads back as the same number.
inline std::string shortest_text(double value) {
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

// A text as messages show it: at most 80 bytes, cut between characters of UTF-8.
inline std::string shown(std::string text) {
  constexpr std::size_t most = 80;
  if (text.size() <= most) return text;
  std::size_t end = most - 3;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0U) == 0x80U) --end;
  return text.substr(0, end) + "...";
}

template <class Value>
[[noreturn]] void refuse(std::string_view argument, const Value& value, std::string_view allowed) {
  std::ostringstream got;
  if constexpr (std::is_floating_point_v<Value>)
    got << shortest_text(value);
  else
    got << value;
  throw std::invalid_argument(std::string(argument) + ": got " + shown(got.str()) +
                              ", allowed: " + std::string(allowed));
}

template <class Value>
void require(bool holds, std::string_view argument, const Value& value, std::string_view allowed) {
  if (!holds) refuse(argument, value, allowed);
}

inline void require_finite(std::string_view argument, double value) {
  require(std::isfinite(value), argument, value, "a finite number");
}

inline void require_positive(std::string_view argument, double value) {
  require(std::isfinite(value) && value > 0, argument, value, "a finite number above 0");
}

inline void require_not_negative(std::string_view argument, double value) {
  require(std::isfinite(value) && value >= 0, argument, value, "a finite number, 0 or above");
}

}  // namespace ocisac
