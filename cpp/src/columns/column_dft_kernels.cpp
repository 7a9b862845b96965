#include "columns/column_dft_kernels.hpp"

#include <numbers>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "columns/column_dft_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

template <class T>
using Tag = hn::CappedTag<T, kColumnPairs<T>>;

template <class T>
struct Complex {
  using Vector = hn::Vec<Tag<T>>;
  HWY_INLINE Complex() {}  // written, since implicit ones are not compiled for the target
  HWY_INLINE Complex(Vector real_part, Vector imaginary_part) : real(real_part), imaginary(imaginary_part) {}
  Vector real, imaginary;
};

template <class T>
HWY_INLINE Complex<T> plus(const Complex<T>& a, const Complex<T>& b) {
  return {hn::Add(a.real, b.real), hn::Add(a.imaginary, b.imaginary)};
}

template <class T>
HWY_INLINE Complex<T> minus(const Complex<T>& a, const Complex<T>& b) {
  return {hn::Sub(a.real, b.real), hn::Sub(a.imaginary, b.imaginary)};
}

// a + j·b
template <class T>
HWY_INLINE Complex<T> plus_j(const Complex<T>& a, const Complex<T>& b) {
  return {hn::Sub(a.real, b.imaginary), hn::Add(a.imaginary, b.real)};
}

// a − j·b
template <class T>
HWY_INLINE Complex<T> minus_j(const Complex<T>& a, const Complex<T>& b) {
  return {hn::Add(a.real, b.imaginary), hn::Sub(a.imaginary, b.real)};
}

// a + factor·b
template <class T>
HWY_INLINE Complex<T> plus_times(const Complex<T>& a, double factor, const Complex<T>& b) {
  const auto real = hn::Set(Tag<T>(), static_cast<T>(factor));
  return {hn::MulAdd(real, b.real, a.real), hn::MulAdd(real, b.imaginary, a.imaginary)};
}

template <class T>
HWY_INLINE Complex<T> times(double factor, const Complex<T>& a) {
  const auto real = hn::Set(Tag<T>(), static_cast<T>(factor));
  return {hn::Mul(real, a.real), hn::Mul(real, a.imaginary)};
}

// (real, imaginary) at `factor` times a
template <class T>
HWY_INLINE Complex<T> times(const T* factor, const Complex<T>& a) {
  const auto real = hn::Set(Tag<T>(), factor[0]), imaginary = hn::Set(Tag<T>(), factor[1]);
  return {hn::NegMulAdd(imaginary, a.imaginary, hn::Mul(real, a.real)),
          hn::MulAdd(imaginary, a.real, hn::Mul(real, a.imaginary))};
}

// The DFT of kRadix values, in place.
template <class T>
HWY_INLINE void short_dft(Complex<T> (&x)[2]) {
  const auto first = x[0];
  x[0] = plus(first, x[1]);
  x[1] = minus(first, x[1]);
}

template <class T>
HWY_INLINE void short_dft(Complex<T> (&x)[3]) {
  const auto sum = plus(x[1], x[2]), difference = times(std::numbers::sqrt3 / 2, minus(x[1], x[2]));
  const auto middle = plus_times(x[0], -0.5, sum);
  x[0] = plus(x[0], sum);
  x[1] = minus_j(middle, difference);
  x[2] = plus_j(middle, difference);
}

template <class T>
HWY_INLINE void short_dft(Complex<T> (&x)[4]) {
  const auto even = plus(x[0], x[2]), even_difference = minus(x[0], x[2]);
  const auto odd = plus(x[1], x[3]), odd_difference = minus(x[1], x[3]);
  x[0] = plus(even, odd);
  x[1] = minus_j(even_difference, odd_difference);
  x[2] = minus(even, odd);
  x[3] = plus_j(even_difference, odd_difference);
}

template <class T>
HWY_INLINE void short_dft(Complex<T> (&x)[5]) {
  constexpr double kCos72 = 0.30901699437494742410, kCos144 = -0.80901699437494742410;
  constexpr double kSin72 = 0.95105651629515357212, kSin144 = 0.58778525229247312917;
  const auto outer = plus(x[1], x[4]), inner = plus(x[2], x[3]);
  const auto outer_difference = minus(x[1], x[4]), inner_difference = minus(x[2], x[3]);
  const auto first = plus_times(plus_times(x[0], kCos72, outer), kCos144, inner);
  const auto second = plus_times(plus_times(x[0], kCos144, outer), kCos72, inner);
  const auto of_first = plus_times(times(kSin144, inner_difference), kSin72, outer_difference);
  const auto of_second = plus_times(times(-kSin72, inner_difference), kSin144, outer_difference);
  x[0] = plus(x[0], plus(outer, inner));
  x[1] = minus_j(first, of_first);
  x[2] = minus_j(second, of_second);
  x[3] = plus_j(second, of_second);
  x[4] = plus_j(first, of_first);
}

// The inverse is the DFT of numbers whose real and imaginary parts are exchanged, with the turns in front of it.
template <class T, std::size_t kRadix, bool kInverse, bool kTurns>
HWY_INLINE void butterfly(T* rows, std::size_t apart, const T* turns, std::size_t pairs) {
  const Tag<T> d;
  constexpr std::size_t kReal = kInverse ? kColumnPairs<T> : 0, kImaginary = kColumnPairs<T> - kReal;
  for (std::size_t c = 0; c < pairs; c += hn::Lanes(d)) {
    Complex<T> x[kRadix];
    for (std::size_t p = 0; p < kRadix; ++p) {
      x[p] = {hn::LoadU(d, rows + p * apart + kReal + c), hn::LoadU(d, rows + p * apart + kImaginary + c)};
      if (kTurns && kInverse && p > 0) x[p] = times(turns + 2 * (p - 1), x[p]);
    }
    short_dft(x);
    for (std::size_t p = 0; p < kRadix; ++p) {
      if (kTurns && !kInverse && p > 0) x[p] = times(turns + 2 * (p - 1), x[p]);
      hn::StoreU(x[p].real, d, rows + p * apart + kReal + c);
      hn::StoreU(x[p].imaginary, d, rows + p * apart + kImaginary + c);
    }
  }
}

template <class T, std::size_t kRadix, bool kInverse>
void step_of(const DftStep<T>& step, T* rows, std::size_t blocks, std::size_t pairs) {
  constexpr std::size_t kRow = 2 * kColumnPairs<T>;
  const std::size_t part = step.length / kRadix;
  for (std::size_t block = 0; block < blocks; ++block, rows += step.length * kRow) {
    butterfly<T, kRadix, kInverse, false>(rows, part * kRow, nullptr, pairs);
    for (std::size_t j = 1; j < part; ++j)
      butterfly<T, kRadix, kInverse, true>(rows + j * kRow, part * kRow, step.turns + 2 * (kRadix - 1) * j, pairs);
  }
}

template <class T, bool kInverse>
void any_step(const DftStep<T>& step, T* rows, std::size_t blocks, std::size_t pairs) {
  switch (step.radix) {
    case 2: return step_of<T, 2, kInverse>(step, rows, blocks, pairs);
    case 3: return step_of<T, 3, kInverse>(step, rows, blocks, pairs);
    case 4: return step_of<T, 4, kInverse>(step, rows, blocks, pairs);
    default: return step_of<T, 5, kInverse>(step, rows, blocks, pairs);
  }
}

template <class T>
void times_gain(T* rows, const T* gain, std::size_t count, std::size_t pairs) {
  const Tag<T> d;
  for (std::size_t n = 0; n < count; ++n, rows += 2 * kColumnPairs<T>)
    for (std::size_t c = 0; c < pairs; c += hn::Lanes(d)) {
      T* const imaginary = rows + kColumnPairs<T> + c;
      const auto product = times(gain + 2 * n, Complex<T>{hn::LoadU(d, rows + c), hn::LoadU(d, imaginary)});
      hn::StoreU(product.real, d, rows + c);
      hn::StoreU(product.imaginary, d, imaginary);
    }
}

DftLoops<float> DftFloats() { return {any_step<float, false>, any_step<float, true>, times_gain<float>}; }
DftLoops<double> DftDoubles() { return {any_step<double, false>, any_step<double, true>, times_gain<double>}; }

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(DftFloats);
HWY_EXPORT(DftDoubles);

template <>
DftLoops<float> dft_loops() {
  return HWY_DYNAMIC_DISPATCH(DftFloats)();
}
template <>
DftLoops<double> dft_loops() {
  return HWY_DYNAMIC_DISPATCH(DftDoubles)();
}

}  // namespace ocisac::kernels
#endif
