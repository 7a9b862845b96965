// Products of elements. Between the edges of their steps a product is a straight line times a sum of cosines, whose
// integral has a closed form; the whole pieces inside an exposure are a difference of prefix sums.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <utility>

#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
#include "light/waveform_elements.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"

namespace ocisac {

namespace {

constexpr double kMaxPieces = 0x1p22;

// Spherical Bessel function of the first kind and order 1: sin(x)/x² − cos(x)/x.
double spherical_bessel_1(double x) {
  if (std::abs(x) > 1) return (std::sin(x) / x - std::cos(x)) / x;
  double series = 1;
  for (double k = 8; k >= 1; --k) series = 1 - x * x / (2 * k * (2 * k + 3)) * series;
  return x / 3 * series;
}

// cos a·cos b = ½·cos(a − b) + ½·cos(a + b)
void append_product(const Cosine& a, const Cosine& b, std::vector<Cosine>& products) {
  const double amplitude = a.amplitude * b.amplitude;
  const auto steady = [](const Cosine& c) { return c.frequency.high == 0 && c.turns.high == 0; };
  if (steady(a) || steady(b)) {
    products.push_back({amplitude, a.frequency + b.frequency, a.turns + b.turns});
    return;
  }
  products.push_back({amplitude / 2, a.frequency - b.frequency, a.turns - b.turns});
  products.push_back({amplitude / 2, a.frequency + b.frequency, a.turns + b.turns});
}

std::vector<Cosine> cosines_of(const WaveformFactors& factors) {
  std::vector<Cosine> all{{1, {}, {}}};
  for (const auto& factor : factors) {
    const std::vector<Cosine> own = factor->cosines();
    if (own.empty()) continue;
    std::vector<Cosine> products;
    for (const Cosine& a : all)
      for (const Cosine& b : own) append_product(a, b, products);
    all = std::move(products);
  }
  return all;
}

// The straight lines of a product of steps, in time order.
std::vector<Step> merged_steps(const WaveformFactors& factors, const Stretch& stretch) {
  std::vector<std::vector<Step>> lists;
  for (const auto& factor : factors)
    if (auto steps = factor->steps(stretch); !steps.empty()) lists.push_back(std::move(steps));
  std::vector<std::size_t> current(lists.size(), 0);
  std::vector<Step> merged;
  DoubleDouble begin;
  const DoubleDouble end{stretch.length, 0};
  do {
    Step piece{begin, 1, 0};
    DoubleDouble next{std::numeric_limits<double>::infinity(), 0};
    for (std::size_t i = 0; i < lists.size(); ++i) {
      const auto& steps = lists[i];
      while (current[i] + 1 < steps.size() && !(begin < steps[current[i] + 1].begin)) ++current[i];
      const Step& step = steps[current[i]];
      const double value = step.slope == 0 ? step.value : step.value + step.slope * (begin - step.begin).value();
      piece.slope = piece.slope * value + piece.value * step.slope;  // one factor has slopes at most
      piece.value *= value;
      if (current[i] + 1 < steps.size() && steps[current[i] + 1].begin < next) next = steps[current[i] + 1].begin;
    }
    merged.push_back(piece);
    begin = next;
  } while (begin < end);
  return merged;
}

// All rows from one set of pieces.
class PiecesLight {
 public:
  PiecesLight(const WaveformFactors& factors, const Exposures& exposures, const Stretch& stretch)
      : exposure_(exposures.exposure),
        line_{exposures.line.origin - stretch.origin, exposures.line.step},
        x_(exposures.instants.x()),
        pieces_(merged_steps(factors, stretch)) {
    for (const Cosine& cosine : cosines_of(factors)) {
      const CycleCounter counter(cosine.frequency, stretch.line(), cosine.turns);
      counter.require_countable(0, stretch.length, "frequency");
      const double frequency = cosine.frequency.value();
      cosines_.push_back({cosine.amplitude, frequency, sinc(frequency * exposure_), counter});
    }
    add_up(stretch.length);
  }

  void operator()(std::size_t first, double scale, const kernels::MeansOutput& to) const {
    for (std::size_t i = 0; i < to.means.size(); ++i) to.put(i, scale * mean_before(line_.at(x_[first + i])));
  }

 private:
  struct CountedCosine {
    double amplitude;
    double frequency;
    double exposure_gain;  // sinc over a whole exposure
    CycleCounter counter;
  };
  void add_up(double length) {
    before_.reserve(pieces_.size());
    DoubleDouble total;
    for (std::size_t i = 0; i < pieces_.size(); ++i) {
      before_.push_back(total);
      const DoubleDouble end = i + 1 < pieces_.size() ? pieces_[i + 1].begin : DoubleDouble{length, 0};
      const double width = (end - pieces_[i].begin).value();
      total = total + exact_product(width, mean(pieces_[i], pieces_[i].begin, width));
    }
  }

  // Mean of the product on [begin, begin + width] of a piece. About the middle m, with half the width h and angular
  // frequency w: (c + s·u)·cos(w(m + u)) has the mean c·cos(wm)·sinc − s·h·sin(wm)·j1(wh).
  double mean(const Step& line, DoubleDouble begin, double width) const {
    const DoubleDouble middle = begin + DoubleDouble{width / 2, 0};
    const double level = line.slope == 0 ? line.value : line.value + line.slope * (middle - line.begin).value();
    if (level == 0 && line.slope == 0) return 0;
    double sum = 0;
    for (const CountedCosine& cosine : cosines_) {
      const double angle = kTwoPi * cosine.counter.at(middle).fraction;
      const double turns = cosine.frequency * width;
      double value = level * std::cos(angle) * (width == exposure_ ? cosine.exposure_gain : sinc(turns));
      if (line.slope != 0)
        value -= line.slope * (width / 2) * std::sin(angle) * spherical_bessel_1(std::numbers::pi * turns);
      sum += cosine.amplitude * value;
    }
    return sum;
  }

  std::size_t piece_at(DoubleDouble time) const {
    const auto later = [](DoubleDouble at, const Step& piece) { return at < piece.begin; };
    const auto next = std::upper_bound(pieces_.begin() + 1, pieces_.end(), time, later);
    return static_cast<std::size_t>(next - pieces_.begin()) - 1;
  }

  double mean_before(DoubleDouble end) const {
    const DoubleDouble begin = end - DoubleDouble{exposure_, 0};
    const std::size_t first = piece_at(begin);
    const std::size_t last = piece_at(end);
    if (first == last) return mean(pieces_[first], begin, exposure_);
    const double head = (pieces_[first + 1].begin - begin).value();
    const double tail = (end - pieces_[last].begin).value();
    const double between = (before_[last] - before_[first + 1]).value();
    return (head * mean(pieces_[first], begin, head) + between +
            tail * mean(pieces_[last], pieces_[last].begin, tail)) /
           exposure_;
  }

  double exposure_;
  TimeLine line_;  // counts from the stretch's origin
  std::span<const double> x_;
  std::vector<CountedCosine> cosines_;
  std::vector<Step> pieces_;
  std::vector<DoubleDouble> before_;  // each: light·seconds of all earlier pieces
};

Stretch stretch_of(const Exposures& exposures) {
  const DoubleDouble origin = exposures.line.at(exposures.instants.first()) - DoubleDouble{exposures.exposure, 0};
  return {origin, (exposures.line.at(exposures.instants.last()) - origin).value()};
}

double max_pieces(const WaveformFactors& factors, double length) {
  double steps = 1;
  for (const auto& factor : factors) steps += factor->max_steps(length);
  return steps;
}

// Rows far apart: the pieces of each row are counted separately.
MeanLight sparse_light(const WaveformFactors& factors, const Exposures& exposures) {
  return [factors, exposures](std::size_t first, double scale, const kernels::MeansOutput& to) {
    for (std::size_t i = 0; i < to.means.size(); ++i) {
      check_interrupt();
      Instants instant(exposures.instants.x().subspan(first + i, 1));
      const Exposures one{exposures.line, exposures.exposure, instant};
      PiecesLight(factors, one, stretch_of(one))(0, scale, {to.means.subspan(i, 1), to.adds, to.steady});
    }
  };
}

}  // namespace

MeanLight product_light(const WaveformFactors& factors, const Exposures& exposures) {
  const Stretch stretch = stretch_of(exposures);
  if (max_pieces(factors, stretch.length) <= kMaxPieces) return PiecesLight(factors, exposures, stretch);
  const double pieces = max_pieces(factors, exposures.exposure);
  require(pieces <= kMaxPieces, "exposure", std::to_string(pieces) + " edges of a product", "at most 2^22 edges");
  return sparse_light(factors, exposures);
}

}  // namespace ocisac
