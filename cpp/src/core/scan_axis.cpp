#include "ocisac/core/scan_axis.hpp"

#include <utility>

namespace ocisac {

namespace {

bool is_across(ScanAxis axis) { return axis == ScanAxis::right || axis == ScanAxis::left; }
bool is_backwards(ScanAxis axis) { return axis == ScanAxis::up || axis == ScanAxis::left; }

Region turned(const Region& region) { return {region.y, region.x, region.height, region.width}; }

// Rows counted from the end, of `rows` of them.
Region from_end(const Region& region, std::size_t rows) {
  return {region.x, rows - region.bottom(), region.width, region.height};
}

}  // namespace

AnyFramesView in_time_order(const AnyFramesView& stored, ScanAxis axis) {
  return std::visit(
      [&](auto view) -> AnyFramesView {
        if (is_across(axis)) {
          std::swap(view.rows, view.columns);
          std::swap(view.row_stride, view.column_stride);
        }
        if (is_backwards(axis)) {
          view.data = view.at(0, view.rows - 1, 0);
          view.row_stride = -view.row_stride;
        }
        return view;
      },
      stored);
}

Region to_time_order(const Region& stored, ScanAxis axis, std::size_t width, std::size_t height) {
  const Region region = is_across(axis) ? turned(stored) : stored;
  return is_backwards(axis) ? from_end(region, is_across(axis) ? width : height) : region;
}

Region to_stored(const Region& box, ScanAxis axis, std::size_t width, std::size_t height) {
  const Region region = is_backwards(axis) ? from_end(box, is_across(axis) ? width : height) : box;
  return is_across(axis) ? turned(region) : region;
}

}  // namespace ocisac
