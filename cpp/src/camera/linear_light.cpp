#include "ocisac/camera/linear_light.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "core/recently_used.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

void check_span(const ToneCurve& curve, double sample_maximum) {
  const double white = white_level(curve, sample_maximum);
  require(curve.kind == ToneCurve::Kind::linear || white > curve.dark_level, "dark_level", curve.dark_level,
          "below the white level (" + std::to_string(white) + " for these samples)");
  for (const double sample : {0.0, sample_maximum}) {
    const double light = linear_light(curve, sample, sample_maximum);
    if (!(std::abs(light) <= std::numeric_limits<float>::max()))
      refuse("gamma", curve.gamma,
             "one whose light is finite in single precision, with dark_level " + shortest_text(curve.dark_level) +
                 " and white_level " + shortest_text(white));
  }
}

template <class T>
std::shared_ptr<const LightTable> made_table(const ToneCurve& curve) {
  auto table = std::make_shared<LightTable>();
  table->light.resize(std::size_t{std::numeric_limits<T>::max()} + 1);
  for (std::size_t value = 0; value < table->light.size(); ++value)
    table->light[value] = linear_light(curve, static_cast<double>(value), sample_maximum<T>());
  for (const double light : table->light) table->rounded.push_back(static_cast<float>(light));
  return table;
}

// 65536 powers take longer than a pass over a frame.
template <class T>
std::shared_ptr<const LightTable> kept_table(const ToneCurve& curve) {
  static RecentlyUsed<ToneCurve, LightTable, 4> kept;
  return kept.get(curve, [&] { return made_table<T>(curve); });
}

// Reads along rows, the order in memory, and writes the transposed block.
template <class T, class Light>
std::vector<double> gather(const FramesView<const T>& view, std::size_t frame, std::size_t first, std::size_t count,
                           Light light) {
  std::vector<double> signals(count * view.rows);
  for (std::size_t row = 0; row < view.rows; ++row)
    for (std::size_t column = 0; column < count; ++column)
      signals[column * view.rows + row] = light(view(frame, row, first + column));
  return signals;
}

}  // namespace

std::vector<double> column_signals(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
                                   const ToneCurve& curve) {
  return std::visit(
      [&]<class T>(const FramesView<const T>& view) {
        check_span(curve, sample_maximum<T>());
        if (curve.kind == ToneCurve::Kind::linear)
          return gather(view, frame, first, count, [&](T v) { return static_cast<double>(v) - curve.dark_level; });
        if constexpr (std::is_integral_v<T>) {
          const auto table = kept_table<T>(curve);
          return gather(view, frame, first, count, [&, light = table->light.data()](T v) { return light[v]; });
        } else {
          return gather(view, frame, first, count,
                        [&](T v) { return linear_light(curve, static_cast<double>(v), sample_maximum<T>()); });
        }
      },
      frames);
}

std::shared_ptr<const LightTable> light_table(const AnyFramesView& frames, const ToneCurve& curve) {
  return std::visit(
      [&]<class T>(const FramesView<const T>&) -> std::shared_ptr<const LightTable> {
        check_span(curve, sample_maximum<T>());
        if constexpr (std::is_integral_v<T>) return kept_table<T>(curve);
        return nullptr;
      },
      frames);
}

Shape shape_of(const AnyFramesView& frames) {
  return std::visit([](const auto& view) { return Shape{view.frames, view.rows, view.columns}; }, frames);
}

AnyFramesView frame_of(const AnyFramesView& frames, std::size_t index) {
  return std::visit([&](const auto& view) -> AnyFramesView { return view.frame(index); }, frames);
}

double sample_maximum(const AnyFramesView& frames) {
  return std::visit([]<class T>(const FramesView<const T>&) { return sample_maximum<T>(); }, frames);
}

double saturation_level(const AnyFramesView& frames, const ToneCurve& curve) {
  return std::visit([&]<class T>(const FramesView<const T>&) { return saturation_level<T>(curve); }, frames);
}

bool holds_integers(const AnyFramesView& frames) {
  return std::visit([]<class T>(const FramesView<const T>&) { return std::is_integral_v<T>; }, frames);
}

void check_shape(const AnyFramesView& frames) {
  const Shape shape = shape_of(frames);
  require(shape.rows > 0, "columns", "0 rows", "at least one row");
  require(shape.columns > 0, "columns", "0 columns", "at least one column");
}

void check_samples(const AnyFramesView& frames, double most) {
  std::visit(
      [most]<class T>(const FramesView<const T>& view) {
        const T limit = static_cast<T>(std::min(most, static_cast<double>(std::numeric_limits<T>::max())));
        if constexpr (std::is_floating_point_v<T>)
          for (std::size_t frame = 0; frame < view.frames; ++frame)
            for (std::size_t row = 0; row < view.rows; ++row) {
              bool finite = true;  // without a branch for each sample
              for (std::size_t column = 0; column < view.columns; ++column) {
                const T v = view(frame, row, column);
                finite &= std::abs(v) <= limit;
              }
              for (std::size_t column = 0; !finite && column < view.columns; ++column) {
                const auto v = static_cast<double>(view(frame, row, column));
                require_finite("columns", v);
                require(std::abs(v) <= most, "columns", v, "samples of at most " + shortest_text(most));
              }
            }
      },
      frames);
}

void check(const AnyFramesView& frames, double most) {
  check_shape(frames);
  check_samples(frames, most);
}

}  // namespace ocisac
