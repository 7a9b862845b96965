// Line codes: bits to chips, and soft chips back to soft bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ocisac {

// Soft bits of a decoded stretch. llr: ln P(1)/P(0) in nats, 0 where unknown.
struct LineDecoding {
  std::vector<double> llr;               // (bits) of the best words for 1 and for 0 (max-log)
  std::vector<std::uint8_t> violations;  // (words) 1 where the hard decisions of a whole word are none of the code
};

// A code of words: each `bits_per_word` bits, most significant first, become `chips_per_word` chips in time order.
class LineCode {
 public:
  // "none" (NRZ), "manchester" (0 → 01, 1 → 10), "4b6b" (both as in IEEE Std 802.15.7) or "8b10b" (Widmer and
  // Franaszek 1983, with running disparity −1 at the beginning of each encoding).
  static LineCode named(std::string_view name);

  // A run-length code given as a table: words[value], strings of 0 and 1 of one length (1 to 16), all different; 2, 4,
  // 16 or 256 of them, so that bytes are whole words.
  static LineCode of_table(std::span<const std::string> words);

  [[nodiscard]] std::size_t bits_per_word() const { return bits_per_word_; }
  [[nodiscard]] std::size_t chips_per_word() const { return chips_per_word_; }
  [[nodiscard]] std::size_t chips_per_byte() const { return 8 / bits_per_word_ * chips_per_word_; }

  // No more equal chips than these follow each other; the largest number for a code that has words of equal chips.
  [[nodiscard]] std::size_t longest_run() const { return longest_run_; }

  // `bits`: whole words of 0 and 1. Gives chips, 1 = bright.
  [[nodiscard]] std::vector<std::uint8_t> encode(std::span<const std::uint8_t> bits) const;

  // `llr`: (chips) whole words, ln P(bright)/P(dark); 0: not seen.
  [[nodiscard]] LineDecoding decode(std::span<const double> llr) const;

  // ln of the likelihood of the chips as words of the code over that as chips at random (max-log), nats. `llr` as in
  // decode; words with a chip that is not seen do not count.
  [[nodiscard]] double evidence(std::span<const double> llr) const;
  // The same where the words begin at an unknown chip: that of the most likely one.
  [[nodiscard]] double evidence_anywhere(std::span<const double> llr) const;

 private:
  LineCode(std::size_t bits_per_word, std::size_t chips_per_word, std::vector<std::uint32_t> at_minus,
           std::vector<std::uint32_t> at_plus);

  [[nodiscard]] bool is_word(std::uint32_t chips) const;

  std::size_t bits_per_word_, chips_per_word_, longest_run_;
  std::vector<std::uint32_t> at_minus_, at_plus_;  // (values) words at running disparity −1 and +1, first chip highest
};

}  // namespace ocisac
