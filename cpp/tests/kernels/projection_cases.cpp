#include <cstdint>
#include <limits>
#include <type_traits>

#include "kernel_cases.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/tones/projection.hpp"
#include "plain_projection.hpp"

namespace kernel_cases {

namespace {

struct FrameCase {
  std::size_t rows, columns, outputs;
  int row_group, limbs;
  std::size_t column_step = 1;
  bool upside_down = false, symmetric = false;
  bool across = false;  // rows are contiguous instead of columns
  bool curved = false;  // read by a table of light
};

// Of integer samples: not monotonic, as no curve is.
template <class T>
std::vector<float> light_of(const FrameCase& of) {
  std::vector<float> light;
  if constexpr (std::is_integral_v<T>)
    for (std::size_t v = 0; of.curved && v <= std::numeric_limits<T>::max(); ++v)
      light.push_back(static_cast<float>(v % 89) / 7 + static_cast<float>(v));
  return light;
}

// Alternately symmetric and antisymmetric about the middle.
std::vector<double> weights_for(const FrameCase& of) {
  const std::size_t groups = of.rows / static_cast<std::size_t>(of.row_group);
  const auto random = random_rows<double>(of.outputs, groups, groups);
  std::vector<double> weights(random.data(), random.data() + random.size());
  for (std::size_t o = 0; of.symmetric && o < of.outputs; ++o)
    for (std::size_t g = 0; g < groups / 2; ++g)
      weights[(o + 1) * groups - 1 - g] = (o % 2 == 0 ? 1 : -1) * weights[o * groups + g];
  return weights;
}

// A frame with rows `width` apart: an even number of columns gives whole vectors.
template <class T>
struct Frame {
  std::size_t width;
  Misaligned<T> memory;
  std::vector<T> turned{};
  ocisac::FramesView<const T> view;
  ocisac::RowWeights weights;
  std::vector<float> light;

  explicit Frame(const FrameCase& of)
      : width(of.columns % 2 == 0 ? (of.columns * of.column_step + 69) / 64 * 64 : of.columns * of.column_step + 6),
        memory(random_rows<T>(of.rows, of.columns * of.column_step, width, 100, 40)),
        view{memory.data(),
             1,
             of.rows,
             of.columns,
             0,
             static_cast<std::ptrdiff_t>(width),
             static_cast<std::ptrdiff_t>(of.column_step)},
        weights(weights_for(of), of.outputs, of.rows, of.row_group, of.limbs),
        light(light_of<T>(of)) {
    if (of.across) {
      for (std::size_t c = 0; c < of.columns; ++c)
        for (std::size_t r = 0; r < of.rows; ++r) turned.push_back(view(0, r, c));
      view = {turned.data(), 1, of.rows, of.columns, 0, 1, static_cast<std::ptrdiff_t>(of.rows)};
      if (of.upside_down) {
        view.data += of.rows - 1;
        view.row_stride = -1;
      }
      return;
    }
    for (std::size_t r = 0; r < of.rows; ++r)  // between the columns of a frame are others
      for (std::size_t c = 0; c < of.columns * of.column_step; ++c)
        if (c % of.column_step != 0) memory.data()[r * width + c] = filler<T>();
    if (of.upside_down) {
      view.data += static_cast<std::ptrdiff_t>((of.rows - 1) * width);
      view.row_stride = -view.row_stride;
    }
  }
};

// Totals relative to 1 + |total|, squares value by value; a part of the columns must give identical bits.
template <class T>
double projection_deviation(const Frame<T>& frame, const FrameCase& of) {
  const auto got = ocisac::project(frame.view, 0, 0, of.columns, frame.weights, frame.light);
  const auto want = project_plainly(frame.view, 0, 0, of.columns, frame.weights, frame.light);
  const std::size_t groups = of.rows / static_cast<std::size_t>(of.row_group);
  const bool folded = frame.weights.folds();
  if (got.maximum != want.maximum || (groups > 4 && folded != (of.symmetric && groups % 2 == 0))) return kInfinite;
  double worst = deviation<double>(got.sums, want.sums);
  for (std::size_t c = 0; c < of.columns; ++c) {
    worst = std::max(worst, std::abs(got.squares[c] / want.squares[c] - 1));
    worst = std::max(worst, std::abs(got.totals[c] - want.totals[c]) / (1 + std::abs(want.totals[c])));
  }
  if (of.columns < 4) return worst;
  const auto part = ocisac::project(frame.view, 0, 3, of.columns - 3, frame.weights, frame.light);
  for (std::size_t o = 0; o < of.outputs; ++o)
    for (std::size_t c = 3; c < of.columns; ++c)
      if (part.sums[o * (of.columns - 3) + c - 3] != got.sums[o * of.columns + c]) return kInfinite;
  return worst;
}

template <class T>
KernelCase projection_case(const char* type, const FrameCase& of, bool timed = false) {
  auto name = std::string("project<") + type + "> " + std::to_string(of.rows) + " × " + std::to_string(of.columns) +
              ", step " + std::to_string(of.column_step) + ", " + std::to_string(of.outputs) + " outputs, groups of " +
              std::to_string(of.row_group) + ", limbs " + std::to_string(of.limbs) +
              (of.upside_down ? ", upside down" : "") + (of.symmetric ? ", symmetric" : "") +
              (of.across ? ", across" : "") + (of.curved ? ", curved" : "");
  const auto compare = [of] { return projection_deviation(Frame<T>(of), of); };
  std::function<void()> run;
  if (timed)
    run = [of, frame = std::make_shared<Frame<T>>(of), out = std::make_shared<ocisac::Projection>()] {
      ocisac::project(frame->view, 0, 0, of.columns, frame->weights, frame->light, *out);
    };
  return {std::move(name), std::move(run), compare, 1e-12};
}

// weighted_rows() with weights of the columns.
template <class T>
KernelCase combination_case(const char* type, const FrameCase& of, bool timed = false) {
  auto name = std::string("weighted_rows<") + type + "> " + std::to_string(of.rows) + " × " +
              std::to_string(of.columns) + ", step " + std::to_string(of.column_step) + (of.across ? ", across" : "") +
              (of.curved ? ", curved" : "");
  const auto frame = std::make_shared<const Frame<T>>(of);
  const auto weights = random_rows<double>(1, of.columns, of.columns);
  const ocisac::ToneCurve curve{.kind = of.curved ? ocisac::ToneCurve::Kind::srgb : ocisac::ToneCurve::Kind::linear};
  const auto combined = [=, weights = std::vector<double>(weights.data(), weights.data() + of.columns)] {
    return ocisac::weighted_rows(frame->view, 0, curve, weights);
  };
  const auto compare = [=] {
    const auto table = ocisac::light_table(frame->view, curve);
    std::vector<double> want(of.rows);
    for (std::size_t r = 0; r < of.rows; ++r)
      for (std::size_t c = 0; c < of.columns; ++c) {
        const T sample = frame->view(0, r, c);
        auto v = static_cast<double>(sample);
        if constexpr (std::is_integral_v<T>)
          if (of.curved) v = table->rounded[sample];
        want[r] += weights.data()[c] * v;
      }
    return deviation<double>(combined(), want);
  };
  std::function<void()> run;
  if (timed) run = [combined] { combined(); };
  return {std::move(name), std::move(run), compare, 1e-12};
}

}  // namespace

std::vector<KernelCase> projection_cases() {
  std::vector<KernelCase> cases;
  cases.push_back(combination_case<std::uint8_t>("uint8", {3, 5000, 0, 1, 1}));
  for (const std::size_t columns : {1u, 2u, 7u, 15u, 16u, 17u, 31u, 33u, 64u, 70u, 131u, 156u})
    for (const std::size_t rows : {8u, 9u, 17u, 33u, 97u})
      for (const int row_group : {1, 2, 4, 8}) {
        const std::size_t outputs = 1 + columns % 5, step = 1 + rows % 2;
        const int limbs = 1 + static_cast<int>(rows % 3);
        const bool odd = rows % 2 == 1;
        cases.push_back(projection_case<std::uint8_t>("uint8", {rows, columns, outputs, row_group, limbs, 1, odd}));
        cases.push_back(
            projection_case<std::uint8_t>("uint8", {rows + 1, columns, outputs, row_group, limbs, 1, odd, true}));
        cases.push_back(projection_case<std::uint16_t>("uint16", {rows, columns, outputs, row_group, 1, 1, odd}));
        cases.push_back(projection_case<float>("float32", {rows, columns, outputs, row_group, 1, step}));
        const FrameCase folded{rows + 1, columns, outputs + 2, row_group, 1, step, odd, true};
        cases.push_back(projection_case<std::uint16_t>("uint16", folded));
        cases.push_back(projection_case<float>("float32", folded));
        cases.push_back(projection_case<double>("float64", folded));
        cases.push_back(projection_case<double>("float64", {rows, columns, outputs, row_group, 1, step, odd}));
      }
  for (const std::size_t columns : {1u, 5u, 64u, 131u, 700u})
    for (const std::size_t rows : {33u, 300u})
      for (const std::size_t step : {1u, 2u, 3u, 4u, 5u})
        for (const int row_group : {1, 8})
          for (const bool across : {false, true}) {
            const bool odd = (columns + step) % 2 == 1;
            const FrameCase plain{rows, columns, 1 + 2 * step, row_group, 1, step, odd, step == 3, across};
            FrameCase curved = plain;
            curved.curved = true;
            curved.symmetric = step > 2;
            cases.push_back(projection_case<std::uint8_t>("uint8", plain));
            cases.push_back(projection_case<std::uint8_t>("uint8", curved));
            cases.push_back(projection_case<std::uint16_t>("uint16", curved));
            cases.push_back(combination_case<std::uint8_t>("uint8", plain));
            cases.push_back(combination_case<std::uint8_t>("uint8", curved));
            cases.push_back(combination_case<std::uint16_t>("uint16", curved));
            cases.push_back(combination_case<float>("float32", plain));
            cases.push_back(combination_case<double>("float64", plain));
          }
  for (const std::size_t columns : {1u, 9u, 70u, 131u})
    for (const std::size_t rows : {64u, 70u, 98u})
      for (const int row_group : {1, 2}) {  // a tone: folded samples; bytes across, and with all that lies between them
        FrameCase tone{rows, columns, 2, row_group, 1, 1 + rows % 5, columns % 2 == 0, true};
        cases.push_back(projection_case<std::uint8_t>("uint8", tone));
        cases.push_back(projection_case<std::uint16_t>("uint16", tone));
        cases.push_back(projection_case<float>("float32", tone));
        cases.push_back(projection_case<double>("float64", tone));
        tone.curved = true;
        cases.push_back(projection_case<std::uint8_t>("uint8", tone));
        tone.across = true;
        tone.curved = tone.upside_down = tone.symmetric = false;
        for (tone.outputs = 0; tone.outputs < 10; ++tone.outputs)
          cases.push_back(projection_case<std::uint8_t>("uint8", tone));
      }
  cases.push_back(projection_case<std::uint8_t>("uint8", {4099, 20, 2, 1, 3, 1, false, false, true}));
  cases.push_back(projection_case<std::uint8_t>("uint8", {5003, 40, 4, 1, 3, 2}));
  cases.push_back(projection_case<std::uint8_t>("uint8", {5003, 40, 4, 4, 1, 1, true}));
  cases.push_back(projection_case<std::uint8_t>("uint8", {5004, 40, 4, 1, 2, 1, false, true}));
  cases.push_back(projection_case<std::uint8_t>("uint8", {5008, 40, 3, 8, 2, 2, true, true}));
  const FrameCase timed{360, 640, 3, 1, 1};
  cases.push_back(projection_case<std::uint8_t>("uint8", timed, true));
  FrameCase curved = timed, across = timed, colours = timed;
  curved.curved = across.across = true;
  colours.column_step = 3;
  cases.push_back(combination_case<std::uint8_t>("uint8", timed, true));
  cases.push_back(combination_case<std::uint16_t>("uint16", timed, true));
  cases.push_back(combination_case<float>("float32", timed, true));
  cases.push_back(combination_case<double>("float64", timed, true));
  cases.push_back(projection_case<std::uint8_t>("uint8", curved, true));
  cases.push_back(projection_case<std::uint8_t>("uint8", across, true));
  cases.push_back(projection_case<std::uint8_t>("uint8", colours, true));
  cases.push_back(projection_case<std::uint16_t>("uint16", timed, true));
  cases.push_back(projection_case<float>("float32", timed, true));
  cases.push_back(projection_case<double>("float64", timed, true));
  const FrameCase tone{360, 640, 2, 1, 1, 1, false, true};
  FrameCase tone_across = tone, tone_of_two = tone, curved_tone = tone;
  tone_across.across = curved_tone.curved = true;
  tone_of_two.column_step = 2;
  for (const FrameCase& of : {tone, tone_across, tone_of_two, curved_tone})
    cases.push_back(projection_case<std::uint8_t>("uint8", of, true));
  cases.push_back(projection_case<std::uint16_t>("uint16", tone, true));
  return cases;
}

}  // namespace kernel_cases
