#include "ocisac/core/scan_axis.hpp"

#include <utility>

namespace ocisac {

AnyFramesView in_time_order(const AnyFramesView& stored, ScanAxis axis) {
  return std::visit(
      [&](auto view) -> AnyFramesView {
        if (axis == ScanAxis::right || axis == ScanAxis::left) {
          std::swap(view.rows, view.columns);
          std::swap(view.row_stride, view.column_stride);
        }
        if (axis == ScanAxis::up || axis == ScanAxis::left) {
          view.data = view.at(0, view.rows - 1, 0);
          view.row_stride = -view.row_stride;
        }
        return view;
      },
      stored);
}

Region to_time_order(const Region& stored, ScanAxis axis, std::size_t width, std::size_t height) {
  switch (axis) {
    case ScanAxis::up: return {stored.x, height - stored.y - stored.height, stored.width, stored.height};
    case ScanAxis::right: return {stored.y, stored.x, stored.height, stored.width};
    case ScanAxis::left: return {stored.y, width - stored.x - stored.width, stored.height, stored.width};
    case ScanAxis::down: break;
  }
  return {stored.x, stored.y, stored.width, stored.height};
}

Region to_stored(const Region& box, ScanAxis axis, std::size_t width, std::size_t height) {
  switch (axis) {
    case ScanAxis::up: return {box.x, height - box.y - box.height, box.width, box.height};
    case ScanAxis::right: return {box.y, box.x, box.height, box.width};
    case ScanAxis::left: return {width - box.y - box.height, box.x, box.height, box.width};
    case ScanAxis::down: break;
  }
  return {box.x, box.y, box.width, box.height};
}

}  // namespace ocisac
