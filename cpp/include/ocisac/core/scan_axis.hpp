// Conversion between the stored picture and rows in time order.
#pragma once

#include "ocisac/core/views.hpp"

namespace ocisac {

enum class ScanAxis { down, up, right, left };  // direction of the rows in time, in the stored picture

// A view with rows in time order.
AnyFramesView in_time_order(const AnyFramesView& stored, ScanAxis axis);

// Conversion of a region between the stored picture of `width` × `height` and that view; it must lie inside.
Region to_time_order(const Region& stored, ScanAxis axis, std::size_t width, std::size_t height);
Region to_stored(const Region& box, ScanAxis axis, std::size_t width, std::size_t height);

}  // namespace ocisac
