#include "ocisac/light/integrate_exposure.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "core/check_interrupt.hpp"
#include "light/waveform_elements.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr std::int64_t kMaxRow = std::int64_t{1} << 52;  // numbers up to it are exact in double
constexpr std::size_t kBlock = 2048;

// out[i]: mean light over exposure i.
void fill(const Waveform& waveform, const Exposures& exposures, std::span<double> out) {
  double steady = 0;
  std::vector<std::pair<double, MeanLight>> parts;
  for (const auto& [coefficient, factors] : waveform.terms()) {
    if (factors.empty())
      steady += coefficient;
    else
      parts.emplace_back(coefficient, factors.size() == 1 ? factors.front()->mean_light(exposures)
                                                          : product_light(factors, exposures));
  }
  for (std::size_t first = 0; first < out.size(); first += kBlock) {
    check_interrupt();
    kernels::MeansOutput to{out.subspan(first, std::min(kBlock, out.size() - first)), false, steady};
    if (parts.empty()) std::ranges::fill(to.means, steady);
    for (const auto& [coefficient, part] : parts) {
      part(first, coefficient, to);
      to.adds = true;
    }
  }
}

void require_one_each(std::size_t asked, std::size_t given) {
  require(asked == given, "out", given, "as many values as are asked for");
}

DoubleDouble frame_start(const Camera& camera, double start, std::int64_t frame) {
  require_finite("start", start);
  if (frame == 0) return {start, 0};
  require(std::abs(static_cast<double>(frame)) <= static_cast<double>(kMaxRow), "frames", frame, "from -2^52 to 2^52");
  if (!camera.frame_time)
    refuse("frame_time", "none", "the frame time of the camera in seconds, needed for several frames");
  return exact_product(static_cast<double>(frame), *camera.frame_time) + DoubleDouble{start, 0};
}

// Row numbers as factors of the row time.
std::vector<double> row_numbers(std::span<const std::int64_t> rows) {
  require(!rows.empty(), "rows", "none", "at least one row");
  return {rows.begin(), rows.end()};
}

void require_exact(std::span<const std::int64_t> rows, const Instants& numbers) {
  if (numbers.first() >= -kMaxRow && numbers.last() <= kMaxRow) return;
  for (std::int64_t row : rows) require(row >= -kMaxRow && row <= kMaxRow, "rows", row, "from -2^52 to 2^52");
}

void integrate(const Waveform& waveform, const Camera& camera, double start, std::int64_t frame, Instants& rows,
               std::span<double> out) {
  const TimeLine line{frame_start(camera, start, frame), camera.row_time};
  fill(waveform, {line, known_exposure(camera, "the light that it collects"), rows}, out);
}

}  // namespace

void integrate_exposure(const Waveform& waveform, const Camera& camera, std::span<const std::int64_t> rows,
                        double start, std::int64_t frame, std::span<double> out) {
  require_one_each(rows.size(), out.size());
  integrate_exposure(waveform, camera, rows, start, std::array{frame}, dense_view(out.data(), 1, 1, out.size()));
}

void integrate_exposure(const Waveform& waveform, const Camera& camera, std::span<const std::int64_t> rows,
                        double start, std::span<const std::int64_t> frames, const FramesView<double>& out) {
  if (frames.empty()) return;
  check(camera);
  const std::vector<double> numbers = row_numbers(rows);
  Instants instants(numbers);
  require_exact(rows, instants);
  require(out.rows == frames.size() && out.columns == rows.size(), "out", "another shape",
          "one value for each frame and row");
  std::vector<double> buffer(out.column_stride == 1 ? 0 : rows.size());
  for (std::size_t j = 0; j < frames.size(); ++j) {
    const std::span<double> means = buffer.empty() ? std::span(out.at(0, j, 0), rows.size()) : std::span(buffer);
    integrate(waveform, camera, start, frames[j], instants, means);
    for (std::size_t i = 0; i < buffer.size(); ++i) out(0, j, i) = buffer[i];
  }
}

void sample_waveform(const Waveform& waveform, std::span<const double> times, std::span<double> out) {
  require_one_each(times.size(), out.size());
  if (times.empty()) return;
  for (double time : times) require_finite("times", time);
  Instants instants(times);
  fill(waveform, {TimeLine{}, 0, instants}, out);
}

}  // namespace ocisac
