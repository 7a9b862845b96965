#include "cleaning/restoring_kernels.hpp"
#include "kernel_cases.hpp"

namespace kernel_cases {

namespace {

using namespace ocisac::kernels;

// Light, its cell and whether the gain is bounded, each (columns), the same bits as by the plain loop.
KernelCase restoring_case(std::size_t columns, const RowGain& row) {
  const LightCells cells{0.1, 400, 256};
  const auto share = std::make_shared<Misaligned<double>>(random_rows<double>(1, columns, columns, 0.5, 0.4));
  const auto light = std::make_shared<Misaligned<double>>(random_rows<double>(1, columns, columns, 0.3, 0.3));
  const auto number = std::make_shared<Misaligned<std::int32_t>>(columns);
  const auto bounded = std::make_shared<Misaligned<std::uint8_t>>(columns);
  const auto run = [=](bool plain, double* out) {
    std::copy_n(light->data(), columns, out);
    if (!plain) apply_gains(row, cells, columns, share->data(), {out, number->data(), bounded->data()});
    for (std::size_t k = 0; k < columns; ++k) {
      const double own = share->data()[k];
      const double gain = (1 + own * row.rise) / std::max(1 + own * row.swing, kLeastLeft);
      if (plain) out[k] *= std::min(gain, row.most);
      const double place = std::clamp((out[k] - cells.first) * cells.per_light, 0.0, cells.last);
      out[columns + k] = plain ? std::trunc(place) : number->data()[k];
      out[2 * columns + k] = plain ? (gain > row.most ? 1 : 0) : bounded->data()[k];
    }
  };
  const std::string name = "apply_gains " + std::to_string(columns) + ", swing " + std::to_string(row.swing);
  return kernel_case<double>(name, 0, {3, columns, columns}, run, columns > 500);
}

}  // namespace

std::vector<KernelCase> restoring_cases() {
  std::vector<KernelCase> cases;
  for (const double swing : {-0.99, 0.0, 0.7})
    for (const std::size_t columns : kLengths) cases.push_back(restoring_case(columns, {swing, 0.1, 8}));
  cases.push_back(restoring_case(1920, {-0.5, 0.1, 8}));
  return cases;
}

}  // namespace kernel_cases
