// tone_gain over types, sizes and strides: the answer for a strided view is that for its dense copy.
#include "ocisac/tones/tone_gain.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "fuzz.hpp"

using namespace ocisac;

namespace {

constexpr double kTolerance = 1e-9;  // of kernels that differ in order

struct Request {
  Camera camera;
  std::vector<double> tones;
  ToneGainOptions options;
};

Request request_of(FuzzedDataProvider& bytes) {
  Request request;
  request.camera.row_time = 1e-5;
  if (bytes.ConsumeBool()) request.camera.exposure = bytes.PickValueInArray({1e-5, 4e-4, 1e-2});
  if (bytes.ConsumeBool()) request.camera.tone_curve = {.kind = ToneCurve::Kind::srgb};
  for (unsigned tones = 1 + bytes.ConsumeIntegral<std::uint8_t>() % 3; tones > 0; --tones)
    request.tones.push_back(bytes.ConsumeBool() ? 10.0 * bytes.ConsumeIntegral<std::uint16_t>()
                                                : bytes.ConsumeFloatingPointInRange<double>(-1, 2e5));
  request.options.method = bytes.ConsumeBool() ? GainMethod::fit : GainMethod::dft;
  request.options.waveform = bytes.ConsumeBool() ? WaveformShape::tone : WaveformShape::square;
  request.options.duty = bytes.PickValueInArray({0.5, 0.2, 0.999, 1.0});
  request.options.efficiency = bytes.PickValueInArray({1.0, 0.9, 0.1});
  // Seldom: a thread's start and the fit of other tones take longer than all else.
  const auto seldom = bytes.ConsumeIntegral<std::uint8_t>();
  request.options.threads = seldom == 1 ? 2 : seldom == 2 ? 0 : 1;
  request.options.robust = seldom == 3 || seldom == 4;
  request.options.pooled = bytes.ConsumeBool();
  return request;
}

// Offset of the first pixel so that all of them lie at 0 or above, and the size of the memory.
std::pair<std::size_t, std::size_t> extent(std::array<std::size_t, 3> sizes, std::array<std::ptrdiff_t, 3> strides) {
  std::ptrdiff_t low = 0, high = 0;
  for (std::size_t axis = 0; axis < sizes.size(); ++axis) {
    if (sizes[axis] == 0) continue;
    const auto reach = static_cast<std::ptrdiff_t>(sizes[axis] - 1) * strides[axis];
    (reach < 0 ? low : high) += reach;
  }
  return {static_cast<std::size_t>(-low), static_cast<std::size_t>(high - low + 1)};
}

template <class T>
T pixel_value(std::size_t k, std::uint8_t seed, bool noisy) {
  static const auto wave = [] {
    std::array<double, 1009> values{};
    for (std::size_t n = 0; n < values.size(); ++n) values[n] = std::cos(0.05 * static_cast<double>(n));
    return values;
  }();
  const double light = 100 + 80 * wave[(k + seed) % wave.size()];
  const auto noise = static_cast<double>((k * 2654435761U >> 7) % 16);
  return static_cast<T>(light + (noisy ? noise : 0));
}

template <class T>
FramesView<const T> dense_copy(const FramesView<const T>& view, std::vector<T>& memory) {
  memory.clear();
  for (std::size_t f = 0; f < view.frames; ++f)
    for (std::size_t y = 0; y < view.rows; ++y)
      for (std::size_t x = 0; x < view.columns; ++x) memory.push_back(view(f, y, x));
  return dense_view<const T>(memory.data(), view.frames, view.rows, view.columns);
}

ToneGain answer(const AnyFramesView& view, const Request& request) {
  return tone_gain(view, request.camera, request.tones, request.options);
}

// Equal up to the order of sums, which pooled gains that the rows hardly determine magnify: weak ones, also of aliases,
// and those of few cycles are refused alike and not compared further.
void compare(const ToneGain& a, const ToneGain& b, bool pooled) {
  fuzz::claim(a.gain.size() == b.gain.size());
  const auto is_close = [](double one, double other) {
    return one == other || std::abs(one - other) <= kTolerance * std::max(1.0, std::abs(other));
  };
  const auto is_doubtful = [](Flags flags) { return (flags & (flag::few_cycles | flag::weak)) != 0; };
  const bool any = pooled && (std::ranges::any_of(a.flags, is_doubtful) || std::ranges::any_of(b.flags, is_doubtful));
  for (std::size_t k = 0; k < a.gain.size(); ++k) {
    fuzz::claim(std::isnan(a.gain[k]) == std::isnan(b.gain[k]));
    if (any || std::isnan(b.gain[k])) continue;
    fuzz::claim(is_close(a.gain[k], b.gain[k]) && is_close(a.mean[k], b.mean[k]));
  }
}

template <class T>
void check(FuzzedDataProvider& bytes) {
  const Request request = request_of(bytes);
  const std::size_t most_rows = bytes.PickValueInArray<std::size_t>({12, 24, 48, 200});
  const std::array<std::size_t, 3> sizes{bytes.PickValueInArray<std::size_t>({1, 1, 1, 2, 0}),
                                         bytes.ConsumeIntegralInRange<std::size_t>(0, most_rows),
                                         bytes.ConsumeIntegralInRange<std::size_t>(0, 40)};
  const auto longest = bytes.PickValueInArray<std::ptrdiff_t>({3, 50});
  std::array<std::ptrdiff_t, 3> strides;
  for (auto& stride : strides) stride = bytes.ConsumeIntegralInRange<std::ptrdiff_t>(-longest, longest);
  const auto [first, pixels] = extent(sizes, strides);
  std::vector<T> memory(pixels);
  const auto seed = bytes.ConsumeIntegral<std::uint8_t>();
  const bool noisy = bytes.ConsumeBool();
  for (std::size_t k = 0; k < pixels; ++k) memory[k] = pixel_value<T>(k, seed, noisy);
  for (std::size_t k = 0; k < pixels && bytes.remaining_bytes() > 0; k += 1 + pixels / 16)
    memory[k] = static_cast<T>(bytes.ConsumeIntegral<std::uint8_t>());
  const FramesView<const T> view{
      memory.data() + first, sizes[0], sizes[1], sizes[2], strides[0], strides[1], strides[2]};
  std::vector<T> dense;
  const ToneGain strided = answer(view, request), same = answer(dense_copy(view, dense), request);
  const std::size_t columns = request.options.pooled ? 1 : sizes[2];
  fuzz::claim(strided.gain.size() == request.tones.size() * sizes[0] * columns);
  compare(strided, same, request.options.pooled);
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzedDataProvider bytes(data, size);
  fuzz::allow_refusal([&] {
    switch (bytes.ConsumeIntegral<std::uint8_t>() % 4) {
      case 0: return check<std::uint8_t>(bytes);
      case 1: return check<std::uint16_t>(bytes);
      case 2: return check<float>(bytes);
      default: return check<double>(bytes);
    }
  });
  return 0;
}
