#include "chips/channel_kernels.hpp"

#include <algorithm>
#include <array>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "chips/channel_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// No operation is fused and sums are split alike on every target: searches compare residuals that differ by rounding
// alone, and read the same bits everywhere.
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
  const Rows exposure_chips = hn::Set(d64, clock.exposure_rows / clock.rows_per_chip);
  const Rows origin = hn::Set(d64, clock.chip);
  const Rows value_scale = hn::Set(d64, clock.rows_per_chip * (1 / clock.exposure_rows));
  for (std::size_t n = 0; n < rows; n += hn::Lanes(d64)) {
    const Rows row = hn::Iota(d64, clock.first + static_cast<double>(n));
    const Rows chips_begin = hn::Div(hn::Sub(hn::Sub(row, half), phase), period);
    const Rows chips_end = hn::Div(hn::Sub(hn::Add(row, half), phase), period);
    const Places begin = places_at<kNear>(chips, hn::Add(chips_begin, origin));
    const Places end = places_at<kNear>(chips, hn::Add(chips_end, origin));
    const Rows between = hn::Sub(hn::Add(hn::Sub(end.sum, begin.sum), end.integral), begin.integral);
    const Rows within = hn::Mul(end.level, exposure_chips);
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
// Emscripten 3.1 compiles the look-up of emulated vectors to other values.
constexpr bool kLooksUp = HWY_TARGET != HWY_EMU128;

void ExposeRows(const ChipSteps& chips, const ExposureClock& clock, std::size_t rows, const ExposedRows& to) {
  if (kLooksUp && clock.rows_per_chip >= kFewRows && chips.count >= hn::Lanes(d64))
    expose_rows<true>(chips, clock, rows, to);
  else
    expose_rows<false>(chips, clock, rows, to);
}

void SubtractLevels(const LevelColumns& columns, std::size_t rows, double* HWY_RESTRICT swing,
                    double* HWY_RESTRICT left) {
  const auto sum_at = [&](std::span<const double> levels, std::size_t n) HWY_ATTR {
    Rows sum = hn::Set(d64, levels[0]);
    for (std::size_t k = 1; k < levels.size(); ++k)
      sum = hn::Add(hn::Mul(hn::Set(d64, levels[k]), hn::LoadU(d64, columns.basis + k * columns.stride + n)), sum);
    return sum;
  };
  for (std::size_t n = 0; n < rows; n += hn::Lanes(d64)) {
    const Rows of_swing = sum_at(columns.swing, n);
    const Rows dark = hn::Mul(sum_at(columns.dark, n), hn::LoadU(d64, columns.basis + n));
    const Rows rest = hn::Sub(hn::LoadU(d64, columns.values + n), dark);
    hn::StoreU(of_swing, d64, swing + n);
    hn::StoreU(hn::Sub(rest, hn::Mul(of_swing, hn::LoadU(d64, columns.exposed + n))), d64, left + n);
  }
}

constexpr std::size_t kPartialSums = 4;
const hn::CappedTag<double, kPartialSums> d_sums;
using Sums = hn::Vec<decltype(d_sums)>;
constexpr std::size_t kVectors = kPartialSums / hn::MaxLanes(d_sums);  // of partial sums
constexpr std::size_t kMostAtOnce = kVectors > 1 ? 4 : 6;              // products, whose sums are in registers

// Multiplies one column with kCount others.
template <std::size_t kCount>
HWY_INLINE void multiply(const double* column, const double* const* others, std::size_t rows,
                         double* HWY_RESTRICT products) {
  Sums sums[kCount][kVectors];
  for (auto& of_other : sums)
    for (Sums& sum : of_other) sum = hn::Zero(d_sums);
  for (std::size_t n = 0; n < rows; n += kPartialSums)
    for (std::size_t v = 0; v < kVectors; ++v) {
      const std::size_t at = n + v * hn::MaxLanes(d_sums);
      const Sums values = hn::LoadU(d_sums, column + at);
      for (std::size_t k = 0; k < kCount; ++k)
        sums[k][v] = hn::Add(hn::Mul(values, hn::LoadU(d_sums, others[k] + at)), sums[k][v]);
    }
  for (std::size_t k = 0; k < kCount; ++k) {
    std::array<double, kPartialSums> parts;
    for (std::size_t v = 0; v < kVectors; ++v) hn::StoreU(sums[k][v], d_sums, parts.data() + v * hn::MaxLanes(d_sums));
    products[k] = (parts[0] + parts[1]) + (parts[2] + parts[3]);
  }
}

void InnerProducts(std::span<const double* const> columns, std::size_t first, std::size_t rows,
                   double* HWY_RESTRICT products, std::size_t stride) {
  for (std::size_t i = first; i < columns.size(); ++i) {
    double* const row = products + i * stride;
    for (std::size_t j = 0; j <= i; j += kMostAtOnce) {
      const double* const* const others = &columns[j];
      switch (std::min(i + 1 - j, kMostAtOnce)) {
        case 1: multiply<1>(columns[i], others, rows, row + j); break;
        case 2: multiply<2>(columns[i], others, rows, row + j); break;
        case 3: multiply<3>(columns[i], others, rows, row + j); break;
        case 4: multiply<4>(columns[i], others, rows, row + j); break;
        case 5: multiply<5>(columns[i], others, rows, row + j); break;
        default: multiply<kMostAtOnce>(columns[i], others, rows, row + j); break;
      }
    }
    for (std::size_t j = 0; j < i; ++j) products[j * stride + i] = row[j];
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ocisac::kernels {

HWY_EXPORT(ExposeRows);
HWY_EXPORT(SubtractLevels);
HWY_EXPORT(InnerProducts);

void expose_rows(const ChipSteps& chips, const ExposureClock& clock, std::size_t rows, const ExposedRows& to) {
  HWY_DYNAMIC_DISPATCH(ExposeRows)(chips, clock, rows, to);
}

void subtract_levels(const LevelColumns& columns, std::size_t rows, double* swing, double* left) {
  HWY_DYNAMIC_DISPATCH(SubtractLevels)(columns, rows, swing, left);
}

void inner_products(std::span<const double* const> columns, std::size_t first, std::size_t rows, double* products,
                    std::size_t stride) {
  HWY_DYNAMIC_DISPATCH(InnerProducts)(columns, first, rows, products, stride);
}

}  // namespace ocisac::kernels
#endif
