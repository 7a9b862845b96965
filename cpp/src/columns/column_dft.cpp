#include "columns/column_dft.hpp"

#include <complex>

#include "core/levels.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

// Parts of a block that fit the first-level cache are finished before the next part is begun.
constexpr std::size_t kRowsInCache = 200;  // of 128 bytes

std::vector<std::size_t> radices_of(std::size_t length) {
  require(length > 0, "length", length, "at least 1");
  std::vector<std::size_t> radices;
  for (std::size_t rest = length; rest > 1; rest /= radices.back()) {
    std::size_t radix = 0;
    for (const std::size_t one : {4u, 2u, 5u, 3u})
      if (radix == 0 && rest % one == 0) radix = one;
    require(radix != 0, "length", length, "2^a·3^b·5^c");
    radices.push_back(radix);
  }
  return radices;
}

}  // namespace

template <class T>
ColumnDft<T>::ColumnDft(std::size_t length) : order_(length) {
  std::size_t part = length, step = 1;  // of the rows that a step leaves together; between their frequencies
  for (const std::size_t radix : radices_of(length)) {
    auto& turns = turns_.emplace_back();
    for (std::size_t j = 0; j < part / radix; ++j)
      for (std::size_t q = 1; q < radix; ++q) {
        const auto turn = std::polar(1.0, -kTwoPi * static_cast<double>(j * q) / static_cast<double>(part));
        turns.push_back(static_cast<T>(turn.real()));
        turns.push_back(static_cast<T>(turn.imag()));
      }
    steps_.push_back({radix, part, nullptr});
    part /= radix;
    for (std::size_t n = 0; n < length; ++n) order_[n] += n / part % radix * step;
    step *= radix;
  }
  for (std::size_t k = 0; k < steps_.size(); ++k) steps_[k].turns = turns_[k].data();
}

template <class T>
void ColumnDft<T>::run(std::size_t first, T* rows, const T* gain, std::size_t pairs, bool forward, bool inverse) const {
  const std::size_t length = first < steps_.size() ? steps_[first].length : 1;
  const auto loops = kernels::dft_loops<T>();
  if (length > kRowsInCache) {
    const auto& step = steps_[first];
    const std::size_t part = length / step.radix;
    if (forward) loops.step(step, rows, 1, pairs);
    for (std::size_t q = 0; q < step.radix; ++q)
      run(first + 1, rows + q * part * 2 * kernels::kColumnPairs<T>, gain ? gain + q * part * 2 : nullptr, pairs,
          forward, inverse);
    if (inverse) loops.inverse_step(step, rows, 1, pairs);
    return;
  }
  if (forward)
    for (std::size_t k = first; k < steps_.size(); ++k) loops.step(steps_[k], rows, length / steps_[k].length, pairs);
  if (gain) loops.multiply_rows(rows, gain, length, pairs);
  if (inverse)
    for (std::size_t k = steps_.size(); k-- > first;)
      loops.inverse_step(steps_[k], rows, length / steps_[k].length, pairs);
}

template class ColumnDft<float>;
template class ColumnDft<double>;

}  // namespace ocisac
