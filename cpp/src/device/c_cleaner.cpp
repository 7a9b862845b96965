#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "device/c_common.hpp"
#include "ocisac/cleaning/stream_cleaner.hpp"

struct ocisac_cleaner {
  ocisac::StreamCleaner stream, slow;  // slow: of what the first leaves
  ocisac::ScanAxis axis;
  double row_time;  // s
  double max_gain;
  bool mean_level;
  std::string unchanged{};  // of the last frame
};

namespace {

using namespace ocisac::c;

constexpr std::size_t kMostPlanes = 4;

ocisac_cleaner_options default_cleaner_options() {
  ocisac_cleaner_options options{};
  options.size = sizeof options;
  options.frame_time = options.noise = options.toe = kNaN;
  options.max_gain = 8;
  options.gamma = ocisac::ToneCurve{}.gamma;
  return options;
}

ocisac_cleaned empty_cleaned() { return {sizeof(ocisac_cleaned), OCISAC_MODEL_ROWS, kNaN, kNaN, kNaN, kNaN, ""}; }

ocisac::RowModel model_of(const ocisac_cleaner_options& options) {
  using ocisac::RowModel;
  constexpr std::array kModels{RowModel::automatic, RowModel::tone, RowModel::chips, RowModel::rows};
  return chosen("model", options.model, kModels);
}

std::int32_t number_of(ocisac::RowModel model) {
  switch (model) {
    case ocisac::RowModel::tone: return OCISAC_MODEL_TONE;
    case ocisac::RowModel::chips: return OCISAC_MODEL_CHIPS;
    default: return OCISAC_MODEL_ROWS;
  }
}

template <class Sample>
ocisac::FramesView<const Sample> view_of(const ocisac_plane& plane) {
  constexpr auto bytes = static_cast<std::ptrdiff_t>(sizeof(Sample));
  ocisac::require(plane.stride % bytes == 0, "stride", plane.stride, "whole pixels");
  ocisac::require(plane.pixel_stride % bytes == 0 && plane.pixel_stride != 0, "pixel_stride", plane.pixel_stride,
                  "whole pixels, not 0");
  const std::size_t others = plane.width - 1, pixel = magnitude(plane.pixel_stride);
  ocisac::require(others == 0 || pixel <= magnitude(plane.stride) / others, "pixel_stride", plane.pixel_stride,
                  "a row of pixels within the stride");
  require_rows(plane.stride, pixel * others + sizeof(Sample), plane.height);
  return {static_cast<const Sample*>(plane.pixels),
          1,
          plane.height,
          plane.width,
          0,
          plane.stride / bytes,
          plane.pixel_stride / bytes};
}

// The planes in order of time.
std::vector<ocisac::AnyFramesView> views_of(const ocisac_plane* planes, std::size_t count, ocisac::ScanAxis axis) {
  ocisac::require(count > 0 && count <= kMostPlanes, "count", count, "1 to 4");
  std::vector<ocisac::AnyFramesView> views;
  for (std::size_t k = 0; k < count; ++k) {
    const ocisac_plane& plane = planes[k];
    ocisac::require(plane.pixels != nullptr && plane.width > 0 && plane.height > 0, "planes", "no pixels",
                    "at least one pixel");
    ocisac::require(plane.format == OCISAC_GRAY8 || plane.format == OCISAC_GRAY16, "format", plane.format,
                    "OCISAC_GRAY8 or OCISAC_GRAY16");
    const auto stored = plane.format == OCISAC_GRAY8 ? ocisac::AnyFramesView(view_of<std::uint8_t>(plane))
                                                     : ocisac::AnyFramesView(view_of<std::uint16_t>(plane));
    views.push_back(ocisac::in_time_order(stored, axis));
  }
  return views;
}

// Planes that are written to.
template <class Sample>
using Planes = std::vector<ocisac::FramesView<Sample>>;

template <class Sample>
void restore(const ocisac_cleaner& cleaner, const ocisac::StreamCleaner::Frame& frame, const Planes<Sample>& planes) {
  const ocisac::ColourLights& lights = frame.light.lights.front();
  for (std::size_t colour = 0; colour < lights.of_colour.size(); ++colour) {
    const ocisac::ModelledLight& light = lights.of(colour);
    std::vector<double> rows = light.light;
    for (double& row : rows) row = std::min(row, light.full);  // brighter rows are fully lit rows with noise
    const double level = cleaner.mean_level ? 1 : frame.light.full_level(0, colour);
    frame.stored.restore<Sample>(0, colour, frame.light.shares[colour], {rows, level, cleaner.max_gain},
                                 {planes[colour]});
  }
}

// Cleans planes of the caller's memory; a failure leaves them as they are. Slow light is searched in a copy that is
// without the faster one.
template <class Sample>
ocisac::SceneLight clean_as(ocisac_cleaner& cleaner, const std::vector<ocisac::AnyFramesView>& views,
                            std::optional<double> time) {
  ocisac::StreamCleaner::Frame frame = cleaner.stream.push(views, time);
  Planes<Sample> planes, copies;
  for (const auto& view : views) {
    const auto& plane = std::get<ocisac::FramesView<const Sample>>(view);
    planes.push_back(
        {const_cast<Sample*>(plane.data), 1, plane.rows, plane.columns, 0, plane.row_stride, plane.column_stride});
  }
  if (!frame.light.may_leave_slow()) {
    cleaner.slow.forget();
    if (frame.light.unchanged.empty()) restore(cleaner, frame, planes);
    return std::move(frame.light);
  }
  const std::size_t rows = planes[0].rows, columns = planes[0].columns;
  std::vector<Sample> memory(planes.size() * rows * columns);
  std::vector<ocisac::AnyFramesView> copied;
  for (std::size_t k = 0; k < planes.size(); ++k) {
    copies.push_back(ocisac::dense_view(&memory[k * rows * columns], 1, rows, columns));
    copied.push_back(ocisac::dense_view<const Sample>(&memory[k * rows * columns], 1, rows, columns));
  }
  restore(cleaner, frame, copies);
  const ocisac::StreamCleaner::Frame slow = cleaner.slow.push(copied, time);
  if (slow.light.unchanged.empty()) restore(cleaner, slow, copies);
  frame.light.join(slow.light);
  for (std::size_t k = 0; k < planes.size(); ++k)
    for (std::size_t n = 0; n < rows; ++n)
      for (std::size_t c = 0; c < columns; ++c) planes[k](0, n, c) = copies[k](0, n, c);
  return std::move(frame.light);
}

ocisac_cleaned cleaned_of(const ocisac_cleaner& cleaner, const ocisac::SceneLight& found) {
  const ocisac::ColourLights& lights = found.lights.front();
  const ocisac::ModelledLight& light = lights.of(0);
  const ocisac::CleaningVerdict& verdict = found.verdicts.front();
  return {sizeof(ocisac_cleaned), number_of(light.model), light.frequency / cleaner.row_time, verdict.light_left,
          verdict.texture_change, verdict.slow_bands,     cleaner.unchanged.c_str()};
}

}  // namespace

extern "C" {

void ocisac_cleaner_options_init(ocisac_cleaner_options* options) { fill(options, default_cleaner_options()); }
void ocisac_cleaned_init(ocisac_cleaned* cleaned) { fill(cleaned, empty_cleaned()); }

int ocisac_cleaner_create(const ocisac_cleaner_options* options, ocisac_cleaner** cleaner) {
  return guarded([&] {
    ocisac::require(cleaner != nullptr, "cleaner", "NULL", "a place for it");
    *cleaner = nullptr;
    const ocisac_cleaner_options all = completed(options, default_cleaner_options(), "options");
    ocisac::require(std::isfinite(all.max_gain) && all.max_gain > 1, "max_gain", all.max_gain,
                    "a finite number above 1");
    const ocisac::Camera camera{all.row_time, {}, known(all.frame_time), tone_curve_of(all)};
    ocisac::StreamCleaner stream(camera, {model_of(all), known(all.noise), known(all.toe)});
    ocisac::StreamCleaner slow(camera, {ocisac::RowModel::slow, known(all.noise), 0});
    *cleaner = new ocisac_cleaner{std::move(stream), std::move(slow), scan_axis_of(all),
                                  all.row_time,      all.max_gain,    all.mean_level != 0};
  });
}

int ocisac_cleaner_push(ocisac_cleaner* cleaner, const ocisac_plane* planes, size_t count, ocisac_cleaned* cleaned) {
  ocisac_stamp stamp;
  ocisac_stamp_init(&stamp);
  return ocisac_cleaner_push_stamped(cleaner, planes, count, &stamp, cleaned);
}

int ocisac_cleaner_push_stamped(ocisac_cleaner* cleaner, const ocisac_plane* planes, size_t count,
                                const ocisac_stamp* stamp, ocisac_cleaned* cleaned) {
  return guarded([&] {
    ocisac::require(cleaner != nullptr && planes != nullptr, "cleaner or planes", "NULL", "both");
    ocisac_stamp unknown;
    ocisac_stamp_init(&unknown);
    const ocisac_stamp stated = completed(stamp, unknown, "stamp");
    if (cleaned != nullptr) completed(cleaned, empty_cleaned(), "cleaned");  // refuses a wrong size before any change
    const std::vector<ocisac::AnyFramesView> views = views_of(planes, count, cleaner->axis);
    const auto clean = planes->format == OCISAC_GRAY8 ? clean_as<std::uint8_t> : clean_as<std::uint16_t>;
    const ocisac::SceneLight light = clean(*cleaner, views, known(stated.time));
    cleaner->unchanged = light.unchanged;
    if (cleaned != nullptr) answer(cleaned, cleaned_of(*cleaner, light), "cleaned");
  });
}

int ocisac_cleaner_forget(ocisac_cleaner* cleaner) {
  return guarded([&] {
    ocisac::require(cleaner != nullptr, "cleaner", "NULL", "one");
    cleaner->stream.forget();
  });
}

void ocisac_cleaner_destroy(ocisac_cleaner* cleaner) { delete cleaner; }

}  // extern "C"
