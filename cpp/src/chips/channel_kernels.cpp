#include "chips/channel_kernels.hpp"

#include <algorithm>
#include <cstdint>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "chips/channel_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

const hn::CappedTag<double, kRowGroup> d64;
using Rows = hn::Vec<decltype(d64)>;

// Ends of the exposures of a vector of rows: their chips, the light there, and its integral from the chips' beginning.
struct Places {
  Rows chip, sum, level, integral;
};

// Table entries at whole indices from `base` on. Those of a vector are neighbours where chips are rows long: registers
// are looked up, in half the time of a gather.
template <bool kNear>
HWY_INLINE Rows entries_at(const double* table, double base, Rows index) {
  const hn::RebindToSigned<decltype(d64)> di;
  const Rows large = hn::Set(d64, 4503599627370496.0);  // 2⁵²: its mantissa counts units
  const auto whole =
      hn::Sub(hn::BitCast(di, hn::Add(hn::Sub(index, hn::Set(d64, base)), large)), hn::BitCast(di, large));
  const double* const from = table + static_cast<std::size_t>(base);
  if constexpr (kNear) return hn::TableLookupLanes(hn::LoadU(d64, from), hn::IndicesFromVec(d64, whole));
  return hn::GatherIndex(d64, from, whole);
}

template <bool kNear>
HWY_INLINE Places places_at(const ChipSteps& chips, Rows at) {
  const auto last = static_cast<double>(chips.count - 1);
  const Rows within = hn::IfThenElseZero(hn::Gt(at, hn::Zero(d64)), hn::Min(at, hn::Set(d64, last)));  // 0 for NaN
  const Rows chip = hn::Floor(within);
  const double base = kNear ? std::min(hn::GetLane(chip), last + 1 - static_cast<double>(hn::Lanes(d64))) : 0.0;
  const Rows level = entries_at<kNear>(chips.targets, base, chip);
  return {chip, entries_at<kNear>(chips.sums, base, chip), level, hn::Mul(level, hn::Sub(at, chip))};
}

// As ChipBox::at.
template <bool kNear>
void expose_rows(const ChipSteps& chips, const ExposureClock& clock, std::size_t rows, const ExposedRows& to) {
  const Rows half = hn::Set(d64, 0.5 * clock.exposure_rows), per_row = hn::Set(d64, 1 / clock.exposure_rows);
  const Rows phase = hn::Set(d64, clock.phase), period = hn::Set(d64, clock.rows_per_chip);
  const Rows exposure = hn::Set(d64, clock.exposure_rows), origin = hn::Set(d64, clock.chip);
  const Rows value_scale = hn::Set(d64, clock.rows_per_chip * (1 / clock.exposure_rows));
  for (std::size_t n = 0; n < rows; n += hn::Lanes(d64)) {
    const Rows row = hn::Iota(d64, clock.first + static_cast<double>(n));
    const Rows chips_begin = hn::Div(hn::Sub(hn::Sub(row, half), phase), period);
    const Rows chips_end = hn::Div(hn::Sub(hn::Add(row, half), phase), period);
    const Places begin = places_at<kNear>(chips, hn::Add(chips_begin, origin));
    const Places end = places_at<kNear>(chips, hn::Add(chips_end, origin));
    const Rows between = hn::Sub(hn::Add(hn::Sub(end.sum, begin.sum), end.integral), begin.integral);
    const Rows within = hn::Div(hn::Mul(end.level, exposure), period);
    const Rows area = hn::IfThenElse(hn::Eq(begin.chip, end.chip), within, between);
    const Rows value = hn::Mul(value_scale, area);
    const Rows moved = hn::Add(hn::Sub(area, hn::Mul(end.level, chips_end)), hn::Mul(begin.level, chips_begin));
    const Rows ends = hn::Mul(hn::Set(d64, 0.5), hn::Add(begin.level, end.level));
    hn::StoreU(value, d64, to.value + n);
    hn::StoreU(hn::Mul(per_row, hn::Sub(begin.level, end.level)), d64, to.by_phase + n);
    hn::StoreU(hn::Mul(per_row, moved), d64, to.by_period + n);
    hn::StoreU(hn::Mul(per_row, hn::Sub(ends, value)), d64, to.by_exposure + n);
  }
}

constexpr double kFewRows = 1.5;  // of a chip, at which those of a vector are no more than its lanes

void ExposeRows(const ChipSteps& chips, const ExposureClock& clock, std::size_t rows, const ExposedRows& to) {
  if (clock.rows_per_chip >= kFewRows && chips.count >= hn::Lanes(d64))
    expose_rows<true>(chips, clock, rows, to);
  else
    expose_rows<false>(chips, clock, rows, to);
}

// Two columns by two: four sums in registers, a load for each product.
void InnerProducts(std::span<const double* const> columns, std::size_t first, std::size_t rows,
                   double* HWY_RESTRICT products, std::size_t stride) {
  const std::size_t last = columns.size() - 1;
  const auto put = [&](std::size_t i, std::size_t j, Rows sum) {
    products[i * stride + j] = products[j * stride + i] = hn::GetLane(hn::SumOfLanes(d64, sum));
  };
  for (std::size_t i = first; i <= last; i += 2)
    for (std::size_t j = 0; j <= std::min(i + 1, last); j += 2) {
      const std::size_t next_i = std::min(i + 1, last), next_j = std::min(j + 1, last);
      const double *a = columns[i], *b = columns[next_i], *c = columns[j], *d = columns[next_j];
      Rows ac = hn::Zero(d64), ad = ac, bc = ac, bd = ac;
      for (std::size_t n = 0; n < rows; n += hn::Lanes(d64)) {
        const Rows of_a = hn::LoadU(d64, a + n), of_b = hn::LoadU(d64, b + n);
        const Rows of_c = hn::LoadU(d64, c + n), of_d = hn::LoadU(d64, d + n);
        ac = hn::MulAdd(of_a, of_c, ac);
        ad = hn::MulAdd(of_a, of_d, ad);
        bc = hn::MulAdd(of_b, of_c, bc);
        bd = hn::MulAdd(of_b, of_d, bd);
      }
      put(i, j, ac);
      put(i, next_j, ad);
      put(next_i, j, bc);
      put(next_i, next_j, bd);
    }
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(ExposeRows);
HWY_EXPORT(InnerProducts);

void expose_rows(const ChipSteps& chips, const ExposureClock& clock, std::size_t rows, const ExposedRows& to) {
  HWY_DYNAMIC_DISPATCH(ExposeRows)(chips, clock, rows, to);
}

void inner_products(std::span<const double* const> columns, std::size_t first, std::size_t rows, double* products,
                    std::size_t stride) {
  HWY_DYNAMIC_DISPATCH(InnerProducts)(columns, first, rows, products, stride);
}

}  // namespace ocisac::kernels
#endif
