// Reed–Solomon code over GF(256) with errors and erasures.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace ocisac {

// Code words of 255 symbols, `data` of them data and first: field polynomial x⁸ + x⁴ + x³ + x² + 1, roots α⁰ to
// α^(254 − data). Corrects e errors and s erasures wherever 2e + s ≤ 255 − data.
class ReedSolomon {
 public:
  static constexpr std::size_t kLength = 255;
  using Word = std::array<std::uint8_t, kLength>;

  // `data`: symbols, 1 to 254.
  explicit ReedSolomon(std::size_t data);

  [[nodiscard]] std::size_t data() const { return data_; }

  [[nodiscard]] Word encode(std::span<const std::uint8_t> data) const;

  // Corrects the word in place; `erased`: places from 0 to 254 without a known symbol, each once. Returns false and
  // leaves the word unchanged where there are too many. A word with more may decode to another word: check the payload.
  [[nodiscard]] bool decode(Word& word, std::span<const int> erased) const;

 private:
  std::size_t data_;
  Word generator_{};  // without its leading 1, the highest power first; 255 − data of them
};

}  // namespace ocisac
