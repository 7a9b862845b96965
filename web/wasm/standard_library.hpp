// What the core uses of C++20 and libc++ 13 (Debian's Emscripten) lacks: algorithms of ranges, std::bit_cast, and the
// text of a number. Included before every source of that build; empty for a library that has them.
#pragma once

#include <version>

#ifndef __cpp_lib_ranges
#include <algorithm>
#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <iterator>
#include <utility>

namespace std {

// The fewest digits that read back as the same number.
inline to_chars_result to_chars(char* first, char* last, double value) {
  char text[32];
  int length = 0;
  for (int digits = 1; digits <= 17; ++digits) {
    length = snprintf(text, sizeof text, "%.*g", digits, value);
    if (strtod(text, nullptr) == value || value != value) break;
  }
  if (last - first < length) return {last, errc::value_too_large};
  return {copy_n(text, length, first), errc{}};
}

template <class To, class From>
constexpr To bit_cast(const From& from) noexcept {
  return __builtin_bit_cast(To, from);
}

namespace ranges {

template <class Compare, class Projection>
constexpr auto compared(Compare& compare, Projection& projection) {
  return [&](auto&& a, auto&& b) -> bool { return invoke(compare, invoke(projection, a), invoke(projection, b)); };
}

template <class Predicate, class Projection>
constexpr auto tested(Predicate& predicate, Projection& projection) {
  return [&](auto&& value) -> bool { return invoke(predicate, invoke(projection, value)); };
}

#define OCISAC_ORDERED(name)                                                                     \
  template <class Range, class Compare = less, class Projection = identity>                      \
  constexpr auto name(Range&& range, Compare compare = {}, Projection projection = {}) {         \
    return std::name(std::begin(range), std::end(range), ranges::compared(compare, projection)); \
  }
OCISAC_ORDERED(sort)
OCISAC_ORDERED(stable_sort)
OCISAC_ORDERED(max_element)
OCISAC_ORDERED(min_element)
OCISAC_ORDERED(minmax_element)
#undef OCISAC_ORDERED

#define OCISAC_TESTED(name)                                                                      \
  template <class Range, class Predicate, class Projection = identity>                           \
  constexpr auto name(Range&& range, Predicate predicate, Projection projection = {}) {          \
    return std::name(std::begin(range), std::end(range), ranges::tested(predicate, projection)); \
  }
OCISAC_TESTED(any_of)
OCISAC_TESTED(all_of)
OCISAC_TESTED(none_of)
OCISAC_TESTED(find_if)
OCISAC_TESTED(find_if_not)
OCISAC_TESTED(count_if)
OCISAC_TESTED(partition_point)
#undef OCISAC_TESTED

template <class Range, class Compare = less, class Projection = identity>
constexpr void nth_element(Range&& range, decltype(std::begin(range)) nth, Compare compare = {},
                           Projection projection = {}) {
  std::nth_element(std::begin(range), nth, std::end(range), ranges::compared(compare, projection));
}

template <class Range, class Value, class Projection = identity>
constexpr auto find(Range&& range, const Value& value, Projection projection = {}) {
  return std::find_if(std::begin(range), std::end(range), [&](auto&& v) { return invoke(projection, v) == value; });
}

template <class Range, class Value, class Projection = identity>
constexpr auto count(Range&& range, const Value& value, Projection projection = {}) {
  return std::count_if(std::begin(range), std::end(range), [&](auto&& v) { return invoke(projection, v) == value; });
}

template <class Range, class Value>
constexpr void fill(Range&& range, const Value& value) {
  std::fill(std::begin(range), std::end(range), value);
}

template <class Range, class Output>
constexpr void copy(Range&& range, Output out) {
  std::copy(std::begin(range), std::end(range), out);
}

template <class Range, class Output, class Predicate, class Projection = identity>
constexpr void copy_if(Range&& range, Output out, Predicate predicate, Projection projection = {}) {
  std::copy_if(std::begin(range), std::end(range), out, ranges::tested(predicate, projection));
}

template <class Range>
constexpr void reverse(Range&& range) {
  std::reverse(std::begin(range), std::end(range));
}

template <class Range>
constexpr void rotate(Range&& range, decltype(std::begin(range)) middle) {
  std::rotate(std::begin(range), middle, std::end(range));
}

template <class Range, class Output, class Predicate, class Projection = identity>
constexpr void remove_copy_if(Range&& range, Output out, Predicate predicate, Projection projection = {}) {
  std::remove_copy_if(std::begin(range), std::end(range), out, ranges::tested(predicate, projection));
}

template <class Range, class Output>
constexpr void move(Range&& range, Output out) {
  std::move(std::begin(range), std::end(range), out);
}

template <class Range, class Output, class Function>
constexpr void transform(Range&& range, Output out, Function function) {
  for (auto&& value : range) *out++ = invoke(function, value);
}

template <class First, class Second, class Output, class Function>
constexpr void transform(First&& first, Second&& second, Output out, Function function) {
  auto b = std::begin(second);
  for (auto a = std::begin(first); a != std::end(first) && b != std::end(second); ++a, ++b)
    *out++ = invoke(function, *a, *b);
}

template <class First, class Second, class Compare = equal_to>
constexpr bool equal(First&& first, Second&& second, Compare compare = {}) {
  return std::equal(std::begin(first), std::end(first), std::begin(second), std::end(second), compare);
}

template <class Range>
constexpr auto min(Range&& range) {
  return *std::min_element(std::begin(range), std::end(range));
}

template <class Range>
constexpr auto max(Range&& range) {
  return *std::max_element(std::begin(range), std::end(range));
}

template <class Range, class Compare = less, class Projection = identity>
constexpr auto minmax(Range&& range, Compare compare = {}, Projection projection = {}) {
  const auto [low, high] = ranges::minmax_element(range, compare, projection);
  return pair(*low, *high);
}

}  // namespace ranges
}  // namespace std
#endif
