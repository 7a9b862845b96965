// From the stored picture to rows in time order, and back.
#pragma once

#include "ocisac/core/views.hpp"
#include "pixel_format.hpp"
#include "settings.hpp"

namespace ocisac::apps {

// A view with rows in time order, columns across.
AnyFramesView in_time_order(const AnyFramesView& stored, ScanAxis axis);

// A part of the stored picture of `width` × `height` in that view, and back. Both lie inside of the picture.
Region to_time_order(const StoredRegion& stored, ScanAxis axis, std::size_t width, std::size_t height);
StoredRegion to_stored(const Region& box, ScanAxis axis, std::size_t width, std::size_t height);

}  // namespace ocisac::apps
