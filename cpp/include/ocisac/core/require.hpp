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

template <class Value>
[[noreturn]] void refuse(std::string_view argument, const Value& value, std::string_view allowed) {
  std::ostringstream message;
  message << argument << ": got ";
  if constexpr (std::is_floating_point_v<Value>)
    message << shortest_text(value);
  else
    message << value;
  message << ", allowed: " << allowed;
  throw std::invalid_argument(message.str());
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
