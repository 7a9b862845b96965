#include "ocisac/packets/line_codes.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <numbers>
#include <utility>

#include "core/check_interrupt.hpp"
#include "core/softplus.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kLongestWord = 16;
constexpr std::size_t kCheckedWords = 1024;  // between two checks for an interrupt

// IEEE Std 802.15.7, 4B6B: three bright chips of six in every word.
constexpr std::array<std::uint32_t, 16> k4b6b = {0b001110, 0b001101, 0b010011, 0b010110, 0b010101, 0b100011,
                                                 0b100110, 0b100101, 0b011001, 0b011010, 0b011100, 0b110001,
                                                 0b110010, 0b101001, 0b101010, 0b101100};

// 8B10B, abcdei at running disparity −1 by EDCBA. Words that are not balanced, and D.7, are inverted at +1.
constexpr std::array<std::uint32_t, 32> k5b6b = {
    0b100111, 0b011101, 0b101101, 0b110001, 0b110101, 0b101001, 0b011001, 0b111000, 0b111001, 0b100101, 0b010101,
    0b110100, 0b001101, 0b101100, 0b011100, 0b010111, 0b011011, 0b100011, 0b010011, 0b110010, 0b001011, 0b101010,
    0b011010, 0b111010, 0b110011, 0b100110, 0b010110, 0b110110, 0b001110, 0b101110, 0b011110, 0b101011};
// 8B10B, fghj at running disparity −1 by HGF. Words that are not balanced, and D.x.3, are inverted at +1.
constexpr std::array<std::uint32_t, 8> k3b4b = {0b1011, 0b1001, 0b0101, 0b1100, 0b1101, 0b1010, 0b0110, 0b1110};

std::uint32_t at_disparity(std::uint32_t word, std::uint32_t bits, bool plus, bool inverts) {
  return plus && (inverts || static_cast<std::uint32_t>(std::popcount(word)) * 2 != bits) ? word ^ ((1U << bits) - 1)
                                                                                          : word;
}

std::uint32_t word_of_8b10b(std::uint32_t value, bool plus) {
  const std::uint32_t x = value & 31, y = value >> 5;
  const std::uint32_t six = at_disparity(k5b6b[x], 6, plus, x == 7);
  const bool then_plus = plus != (std::popcount(six) != 3);
  const bool alternate = y == 7 && (then_plus ? x == 11 || x == 13 || x == 14 : x == 17 || x == 18 || x == 20);
  const std::uint32_t four = at_disparity(alternate ? 0b0111 : k3b4b[y], 4, then_plus, y == 3);
  return six << 4 | four;
}

std::vector<std::uint32_t> table_of_8b10b(bool plus) {
  std::vector<std::uint32_t> words(256);
  for (std::uint32_t value = 0; value < 256; ++value) words[value] = word_of_8b10b(value, plus);
  return words;
}

std::uint32_t parse_word(const std::string& word, std::size_t chips) {
  require(word.size() == chips && !word.empty() && word.size() <= kLongestWord &&
              word.find_first_not_of("01") == std::string::npos,
          "line_code", '"' + word + '"', "words of 0 and 1, all of one length from 1 to 16 chips");
  std::uint32_t value = 0;
  for (char chip : word) value = value << 1 | (chip == '1' ? 1U : 0U);
  return value;
}

// Σ llr over the bright chips of each word, its log-likelihood up to a constant, from tables of its two halves.
class WordScores {
 public:
  explicit WordScores(std::size_t chips)
      : half_(chips / 2), low_(std::size_t{1} << half_), high_(1U << (chips - half_)) {}

  void read(std::span<const double> llr) {  // the first chip is the word's highest bit
    const auto sums = [](std::span<const double> chips, std::vector<double>& table) {
      for (std::size_t word = 1; word < table.size(); ++word)
        table[word] =
            table[word & (word - 1)] + chips[chips.size() - 1 - static_cast<std::size_t>(std::countr_zero(word))];
    };
    sums(llr.first(llr.size() - half_), high_);
    sums(llr.last(half_), low_);
  }
  [[nodiscard]] double of(std::uint32_t word) const { return high_[word >> half_] + low_[word & (low_.size() - 1)]; }

 private:
  std::size_t half_;
  std::vector<double> low_, high_;
};

std::size_t longest_run_of(const std::vector<std::uint32_t>& words, std::size_t chips) {
  std::size_t inside = 0;
  std::array<std::size_t, 2> first{}, last{};  // of dark chips, of bright ones
  for (const std::uint32_t word : words) {
    const auto is_bright = [&](std::size_t chip) { return word >> (chips - 1 - chip) & 1U; };
    for (std::size_t begin = 0, end = 0; begin < chips; begin = end) {
      while (end < chips && is_bright(end) == is_bright(begin)) ++end;
      const std::size_t run = end - begin;
      if (run == chips) return std::numeric_limits<std::size_t>::max();
      inside = std::max(inside, run);
      if (begin == 0) first[is_bright(0)] = std::max(first[is_bright(0)], run);
      if (end == chips) last[is_bright(begin)] = std::max(last[is_bright(begin)], run);
    }
  }
  return std::max({inside, first[0] + last[0], first[1] + last[1]});
}

}  // namespace

LineCode::LineCode(std::size_t bits_per_word, std::size_t chips_per_word, std::vector<std::uint32_t> at_minus,
                   std::vector<std::uint32_t> at_plus)
    : bits_per_word_(bits_per_word),
      chips_per_word_(chips_per_word),
      longest_run_(std::max(longest_run_of(at_minus, chips_per_word), longest_run_of(at_plus, chips_per_word))),
      at_minus_(std::move(at_minus)),
      at_plus_(std::move(at_plus)) {}

LineCode LineCode::named(std::string_view name) {
  const auto fixed = [](std::size_t bits, std::size_t chips, const std::vector<std::uint32_t>& words) {
    return LineCode(bits, chips, words, words);
  };
  if (name == "none") return fixed(1, 1, {0, 1});
  if (name == "manchester") return fixed(1, 2, {0b01, 0b10});
  if (name == "4b6b") return fixed(4, 6, {k4b6b.begin(), k4b6b.end()});
  if (name == "8b10b") return {8, 10, table_of_8b10b(false), table_of_8b10b(true)};
  refuse("line_code", '"' + std::string(name) + '"', "none, manchester, 4b6b, 8b10b or a table of words");
}

LineCode LineCode::of_table(std::span<const std::string> words) {
  const std::size_t count = words.size();
  require(count == 2 || count == 4 || count == 16 || count == 256, "line_code", std::to_string(count) + " words",
          "2, 4, 16 or 256 words, one for each value");
  std::vector<std::uint32_t> table;
  for (const auto& word : words) {
    table.push_back(parse_word(word, words[0].size()));
    require(std::ranges::count(table, table.back()) == 1, "line_code", '"' + word + "\" twice", "words that differ");
  }
  return {static_cast<std::size_t>(std::countr_zero(count)), words[0].size(), table, table};
}

std::vector<std::uint8_t> LineCode::encode(std::span<const std::uint8_t> bits) const {
  require(bits.size() % bits_per_word_ == 0, "bits", std::to_string(bits.size()) + " bits",
          "whole words of " + std::to_string(bits_per_word_) + " bits");
  std::vector<std::uint8_t> chips;
  chips.reserve(bits.size() / bits_per_word_ * chips_per_word_);
  bool plus = false;
  for (std::size_t first = 0; first < bits.size(); first += bits_per_word_) {
    std::uint32_t value = 0;
    for (std::size_t bit = 0; bit < bits_per_word_; ++bit) {
      require(bits[first + bit] <= 1, "bits", int{bits[first + bit]}, "0 and 1");
      value = value << 1 | bits[first + bit];
    }
    const std::uint32_t word = (plus ? at_plus_ : at_minus_)[value];
    plus = plus != (2 * static_cast<std::size_t>(std::popcount(word)) != chips_per_word_);
    for (std::size_t chip = chips_per_word_; chip-- > 0;) chips.push_back(static_cast<std::uint8_t>(word >> chip & 1U));
  }
  return chips;
}

bool LineCode::is_word(std::uint32_t chips) const {
  return std::ranges::find(at_minus_, chips) != at_minus_.end() || std::ranges::find(at_plus_, chips) != at_plus_.end();
}

LineDecoding LineCode::decode(std::span<const double> llr) const {
  require(llr.size() % chips_per_word_ == 0, "llr", std::to_string(llr.size()) + " chips",
          "whole words of " + std::to_string(chips_per_word_) + " chips");
  LineDecoding decoded;
  decoded.llr.reserve(llr.size() / chips_per_word_ * bits_per_word_);
  std::vector<std::array<double, 2>> best(bits_per_word_);
  WordScores scores(chips_per_word_);
  for (std::size_t first = 0; first < llr.size(); first += chips_per_word_) {
    if (first / chips_per_word_ % kCheckedWords == 0) check_interrupt();
    const auto chips = llr.subspan(first, chips_per_word_);
    scores.read(chips);
    best.assign(bits_per_word_, {-std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()});
    for (std::size_t value = 0; value < at_minus_.size(); ++value) {
      const double likelihood = std::max(scores.of(at_minus_[value]), scores.of(at_plus_[value]));
      for (std::size_t bit = 0; bit < bits_per_word_; ++bit) {
        double& of_value = best[bit][value >> (bits_per_word_ - 1 - bit) & 1U];
        of_value = std::max(of_value, likelihood);
      }
    }
    for (const auto& [zero, one] : best) decoded.llr.push_back(one - zero);
    std::uint32_t hard = 0;
    for (double chip : chips) hard = hard << 1 | (chip > 0 ? 1U : 0U);
    const bool whole = std::ranges::find(chips, 0.0) == chips.end();
    decoded.violations.push_back(whole && !is_word(hard) ? 1 : 0);
  }
  return decoded;
}

double LineCode::evidence(std::span<const double> llr) const {
  const double chances = std::log(static_cast<double>(at_minus_.size())) -
                         static_cast<double>(chips_per_word_) * std::numbers::ln2;  // ln P(word)/P(its chips)
  WordScores scores(chips_per_word_);
  double sum = 0;
  for (; llr.size() >= chips_per_word_; llr = llr.subspan(chips_per_word_)) {
    const auto chips = llr.first(chips_per_word_);
    if (std::ranges::find(chips, 0.0) != chips.end()) continue;
    scores.read(chips);
    double best = -std::numeric_limits<double>::infinity();
    for (std::size_t value = 0; value < at_minus_.size(); ++value)
      best = std::max({best, scores.of(at_minus_[value]), scores.of(at_plus_[value])});
    for (const double chip : chips) best -= softplus(chip);
    sum += best - chances;
  }
  return sum;
}

double LineCode::evidence_anywhere(std::span<const double> llr) const {
  double most = evidence(llr);
  for (std::size_t skipped = 1; skipped < std::min(chips_per_word_, llr.size()); ++skipped)
    most = std::max(most, evidence(llr.subspan(skipped)));
  return most;
}

}  // namespace ocisac
