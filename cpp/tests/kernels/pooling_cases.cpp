#include "columns/row_kernels.hpp"
#include "kernel_cases.hpp"

namespace kernel_cases {

namespace {

// (rows), the same bits as by the plain loop.
template <class T>
KernelCase pooling_case(std::size_t rows, std::size_t columns) {
  constexpr std::size_t kSums = 8;
  const double largest = std::is_integral_v<T> ? static_cast<double>(std::numeric_limits<T>::max()) : 1.0;
  const std::size_t stride = columns + 5;
  auto samples = std::make_shared<Misaligned<T>>(random_rows<T>(rows, columns, stride, 0.5 * largest, 0.2 * largest));
  auto weights = std::make_shared<Misaligned<double>>(random_rows<double>(1, columns, columns, 1, 0.5));
  const auto run = [=](bool plain, double* out) {
    if (!plain)
      return ocisac::kernels::pool_rows(
          ocisac::kernels::StoredRows<T>{samples->data(), static_cast<std::ptrdiff_t>(stride), 0, rows, columns},
          weights->data(), out);
    for (std::size_t r = 0; r < rows; ++r) {
      const T* row = samples->data() + r * stride;
      const std::size_t whole = columns / kSums * kSums;
      std::array<double, kSums> sums{};
      for (std::size_t c = 0; c < whole; ++c) sums[c % kSums] += weights->data()[c] * static_cast<double>(row[c]);
      out[r] = 0;
      for (const double sum : sums) out[r] += sum;
      for (std::size_t c = whole; c < columns; ++c) out[r] += weights->data()[c] * static_cast<double>(row[c]);
    }
  };
  return kernel_case<double>("pool_rows " + std::to_string(8 * sizeof(T)) +
                                 (std::is_integral_v<T> ? " bit, " : " bit float, ") + std::to_string(rows) + " x " +
                                 std::to_string(columns),
                             0, {1, rows, rows}, run, rows > 500);
}

template <class T>
void add_cases(std::vector<KernelCase>& cases) {
  for (const std::size_t columns : kLengths)
    for (const std::size_t rows : {1u, 3u, 4u, 5u, 9u}) cases.push_back(pooling_case<T>(rows, columns));
  cases.push_back(pooling_case<T>(1080, 432));
}

}  // namespace

std::vector<KernelCase> pooling_cases() {
  std::vector<KernelCase> cases;
  add_cases<std::uint8_t>(cases);
  add_cases<std::uint16_t>(cases);
  add_cases<float>(cases);
  add_cases<double>(cases);
  return cases;
}

}  // namespace kernel_cases
