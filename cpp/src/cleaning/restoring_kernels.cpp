#include "cleaning/restoring_kernels.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "cleaning/restoring_kernels.cpp"
#include <hwy/foreach_target.h>  // compiles the rest once for each target
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ocisac::kernels {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

template <class D>
HWY_INLINE void apply_to_vector(D d, const RowGain& row, const LightCells& cells, const double* share, const Lit& lit,
                                std::size_t at) {
  const auto one = hn::Set(d, 1.0), most = hn::Set(d, row.most), own = hn::LoadU(d, share + at);
  const auto left = hn::Max(hn::Add(one, hn::Mul(own, hn::Set(d, row.swing))), hn::Set(d, kLeastLeft));
  const auto gain = hn::Div(hn::Add(one, hn::Mul(own, hn::Set(d, row.rise))), left);
  const auto light = hn::Mul(hn::LoadU(d, lit.light + at), hn::Min(gain, most));
  const auto place = hn::Mul(hn::Sub(light, hn::Set(d, cells.first)), hn::Set(d, cells.per_light));
  const auto within = hn::Min(hn::Max(place, hn::Zero(d)), hn::Set(d, cells.last));
  const auto is_bounded = hn::IfThenElseZero(hn::Gt(gain, most), one);
  const hn::Rebind<std::int32_t, D> d32;
  const hn::Rebind<std::uint8_t, D> d8;
  hn::StoreU(light, d, lit.light + at);
  hn::StoreU(hn::DemoteTo(d32, within), d32, lit.cell + at);
  hn::StoreU(hn::DemoteTo(d8, hn::DemoteTo(d32, is_bounded)), d8, lit.is_bounded + at);
}

void ApplyGains(const RowGain& row, const LightCells& cells, std::size_t columns, const double* share, const Lit& lit) {
  const hn::ScalableTag<double> d;
  const hn::CappedTag<double, 1> single;
  std::size_t k = 0;
  for (; k + hn::Lanes(d) <= columns; k += hn::Lanes(d)) apply_to_vector(d, row, cells, share, lit, k);
  for (; k < columns; ++k) apply_to_vector(single, row, cells, share, lit, k);
}

}  // namespace HWY_NAMESPACE
}  // namespace ocisac::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace ocisac::kernels {

HWY_EXPORT(ApplyGains);

void apply_gains(const RowGain& row, const LightCells& cells, std::size_t columns, const double* share,
                 const Lit& lit) {
  HWY_DYNAMIC_DISPATCH(ApplyGains)(row, cells, columns, share, lit);
}

}  // namespace ocisac::kernels
#endif
