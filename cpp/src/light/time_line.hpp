// Times and cycle counts whose fraction keeps its precision after any number of cycles.
#pragma once

#include <cmath>

namespace ocisac {

inline constexpr double kMaxCycles = 0x1p50;  // that are counted: beyond it doubles have no fractions to speak of

// An unevaluated sum high + low, |low| <= half a unit in the last place of high: about 32 decimal digits.
struct DoubleDouble {
  double high = 0;
  double low = 0;

  double value() const { return high + low; }
  bool operator==(const DoubleDouble&) const = default;
};

// a + b without error.
inline DoubleDouble exact_sum(double a, double b) {
  const double sum = a + b;
  const double part = sum - a;
  return {sum, (a - (sum - part)) + (b - part)};
}

// a·b without error.
inline DoubleDouble exact_product(double a, double b) {
  const double product = a * b;
  return {product, std::fma(a, b, -product)};
}

inline DoubleDouble operator-(DoubleDouble a) { return {-a.high, -a.low}; }

inline DoubleDouble operator+(DoubleDouble a, DoubleDouble b) {
  const DoubleDouble high = exact_sum(a.high, b.high);
  const DoubleDouble low = exact_sum(a.low, b.low);
  const DoubleDouble part = exact_sum(high.high, high.low + low.high);
  return exact_sum(part.high, part.low + low.low);
}

inline DoubleDouble operator-(DoubleDouble a, DoubleDouble b) { return a + (-b); }

inline DoubleDouble operator*(DoubleDouble a, DoubleDouble b) {
  const DoubleDouble high = exact_product(a.high, b.high);
  return exact_sum(high.high, high.low + (a.high * b.low + a.low * b.high));
}

inline DoubleDouble operator/(DoubleDouble a, double b) {
  const double quotient = a.high / b;
  return exact_sum(quotient, (std::fma(-quotient, b, a.high) + a.low) / b);
}

inline bool operator<(DoubleDouble a, DoubleDouble b) { return a.high < b.high || (a.high == b.high && a.low < b.low); }

// The nearest whole number, |value| < 2^51; inline arithmetic where the processor's rounding instruction may be absent.
inline double nearest_whole(double value) {
  constexpr double kShift = 0x1.8p52;
  return (value + kShift) - kShift;
}

// t(x) = origin + x·step in seconds: x is a row number and step the row time, or x a time and step 1.
struct TimeLine {
  DoubleDouble origin;
  double step = 1;

  DoubleDouble at(double x) const { return origin + exact_product(x, step); }
};

// A count of cycles: whole + fraction + rest, fraction in [-1/2, 1/2], |rest| <= half its last place.
struct Position {
  double whole = 0;
  double fraction = 0;
  double rest = 0;
};

// Cycles rate·t(x) + offset along a time line: products are exact, and whole cycles are removed before rounding.
class CycleCounter {
 public:
  CycleCounter(DoubleDouble rate, const TimeLine& line, DoubleDouble offset = {});

  Position at(double x) const { return at(x, 0); }
  Position at(DoubleDouble x) const { return at(x.high, x.low * step_.high); }

  // Cycles per unit of x.
  DoubleDouble step() const { return step_; }
  // Whole cycles at x = 0, and the rest, of which `high` is a multiple of `grid`, a power of two.
  double origin_whole() const { return base_whole_; }
  DoubleDouble origin_rest(double grid) const;

  // Throws std::invalid_argument that names `argument` where a count between the two x is too large to keep a fraction.
  void require_countable(double x_first, double x_last, const char* argument) const;

 private:
  Position at(double x, double more_cycles) const {
    const DoubleDouble product = exact_product(x, step_.high);
    const double whole = nearest_whole(product.high);
    DoubleDouble part = exact_sum(product.high - whole, base_.high);
    part.low += product.low + x * step_.low + base_.low + more_cycles;
    const double more = nearest_whole(part.high);
    part = exact_sum(part.high - more, part.low);
    return {whole + more + base_whole_, part.high, part.low};
  }

  DoubleDouble step_;
  double base_whole_;
  DoubleDouble base_;  // the rest of the count at x = 0, within [-1/2, 1/2]
};

// An angle in radians as turns.
DoubleDouble turns(double angle);

}  // namespace ocisac
