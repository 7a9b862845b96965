// What the sources of the C interface share: structs of any version, errors as codes, constants as values.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/core/scan_axis.hpp"
#include "ocisac/ocisac.h"

namespace ocisac::c {

using ocisac::kNaN;

// Keeps the message for ocisac_last_error().
void remember(const char* message);

// Runs the body, which returns a code or nothing, and converts exceptions to error codes.
template <class Body>
int guarded(Body body) noexcept {
  try {
    if constexpr (!std::is_void_v<decltype(body())>) return body();
    body();
    return OCISAC_OK;
  } catch (const std::invalid_argument& problem) {
    remember(problem.what());
    return OCISAC_BAD_ARGUMENT;
  } catch (const std::bad_alloc&) {
    remember("out of memory");
    return OCISAC_NO_MEMORY;
  } catch (const std::exception& problem) {
    remember(problem.what());
    return OCISAC_FAILED;
  }
}

// An _init function writes the defaults, if there is a place for them.
template <class Struct>
void fill(Struct* place, const std::type_identity_t<Struct>& defaults) {
  if (place != nullptr) *place = defaults;
}

// The fields known to the calling program; defaults for the others.
template <class Struct>
Struct completed(const Struct* given, Struct defaults, const char* name) {
  ocisac::require(given != nullptr, name, "NULL", "a struct");
  ocisac::require(given->size >= sizeof(std::size_t) && given->size <= 4096, name, given->size,
                  "the size that its _init function fills in");
  std::memcpy(&defaults, given, std::min(given->size, sizeof(Struct)));
  return defaults;
}

inline std::optional<double> known(double value) { return std::isnan(value) ? std::nullopt : std::optional(value); }

// The value that a constant of the header stands for.
template <class Value, std::size_t count>
Value chosen(const char* name, std::int32_t number, const std::array<Value, count>& values) {
  ocisac::require(number >= 0 && number < static_cast<std::int32_t>(count), name, number,
                  "0 to " + std::to_string(count - 1));
  return values[static_cast<std::size_t>(number)];
}

// Of any struct with these fields.
template <class Options>
ocisac::ToneCurve tone_curve_of(const Options& options) {
  using Kind = ocisac::ToneCurve::Kind;
  constexpr std::array kinds{Kind::linear, Kind::srgb, Kind::gamma};
  return {chosen("tone_curve", options.tone_curve, kinds), options.gamma, options.dark_level, options.white_level};
}

template <class Options>
ocisac::ScanAxis scan_axis_of(const Options& options) {
  using ocisac::ScanAxis;
  constexpr std::array axes{ScanAxis::down, ScanAxis::up, ScanAxis::right, ScanAxis::left};
  return chosen("scan_axis", options.scan_axis, axes);
}

// Without overflow, also of the most negative value.
inline std::size_t magnitude(std::ptrdiff_t value) {
  return value < 0 ? 0 - static_cast<std::size_t>(value) : static_cast<std::size_t>(value);
}

// Rows of `row` bytes must not overlap, nor reach beyond any memory. The stride is in bytes.
inline void require_rows(std::ptrdiff_t stride, std::size_t row, std::size_t height) {
  constexpr std::size_t memory = std::numeric_limits<std::ptrdiff_t>::max();
  ocisac::require(magnitude(stride) >= row && magnitude(stride) <= memory / height, "stride", stride,
                  "at least a row of pixels, and rows within memory");
}

// Fills in the fields that the calling program knows.
template <class Struct>
void answer(Struct* place, Struct full, const char* name) {
  ocisac::require(place->size >= sizeof(std::size_t) && place->size <= 4096, name, place->size,
                  "the size that its _init function fills in");
  full.size = place->size;
  std::memcpy(place, &full, std::min(full.size, sizeof(Struct)));
}

}  // namespace ocisac::c
