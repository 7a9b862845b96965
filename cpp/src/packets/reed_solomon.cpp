// After R. E. Blahut, Algebraic Codes for Data Transmission (2003), chapter 7: Berlekamp–Massey algorithm initialised
// with the erasure locator, Chien search, Forney magnitudes.
#include "packets/reed_solomon.hpp"

#include <algorithm>
#include <string>

#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kOrder = ReedSolomon::kLength;  // of the field's multiplicative group
constexpr unsigned kFieldPolynomial = 0x11d;

struct Field {
  std::array<std::uint8_t, 2 * kOrder> power{};      // of α
  std::array<std::uint8_t, kOrder + 1> logarithm{};  // of what is not 0
  constexpr Field() {
    unsigned value = 1;
    for (std::size_t k = 0; k < kOrder; ++k) {
      power[k] = power[k + kOrder] = static_cast<std::uint8_t>(value);
      logarithm[value] = static_cast<std::uint8_t>(k);
      value <<= 1;
      if (value > kOrder) value ^= kFieldPolynomial;
    }
  }
};
constexpr Field kField;

using Symbol = std::uint8_t;
using Polynomial = std::array<Symbol, kOrder + 1>;  // coefficient of x^k at k

Symbol power_of_alpha(std::size_t exponent) { return kField.power[exponent % kOrder]; }

Symbol product(Symbol a, Symbol b) {
  return a == 0 || b == 0 ? Symbol{0} : kField.power[std::size_t{kField.logarithm[a]} + kField.logarithm[b]];
}

// b is not 0.
Symbol quotient(Symbol a, Symbol b) {
  return a == 0 ? Symbol{0} : kField.power[kOrder + kField.logarithm[a] - kField.logarithm[b]];
}

Symbol value_at(const Polynomial& polynomial, std::size_t degree, Symbol x) {
  Symbol sum = 0;
  for (std::size_t k = degree + 1; k-- > 0;) sum = static_cast<Symbol>(product(sum, x) ^ polynomial[k]);
  return sum;
}

std::size_t degree_of(const Polynomial& polynomial) {
  std::size_t degree = kOrder;
  while (degree > 0 && polynomial[degree] == 0) --degree;
  return degree;
}

void times_x(Polynomial& polynomial) {
  std::shift_right(polynomial.begin(), polynomial.end(), 1);
  polynomial[0] = 0;
}

// Syndromes: the word's values at the code's roots; true where all are 0. A symbol α^e at x^p adds α^(e + p·root).
bool syndromes(const ReedSolomon::Word& word, std::size_t roots, Polynomial& values) {
  std::array<std::size_t, kOrder> exponents, powers;
  std::size_t count = 0;
  for (std::size_t k = 0; k < kOrder; ++k) {
    if (word[k] == 0) continue;
    exponents[count] = kField.logarithm[word[k]];
    powers[count++] = kOrder - 1 - k;
  }
  bool is_word = true;
  for (std::size_t root = 0; root < roots; ++root) {
    Symbol sum = 0;
    for (std::size_t k = 0; k < count; ++k) {
      sum = static_cast<Symbol>(sum ^ kField.power[exponents[k]]);
      exponents[k] += powers[k];
      exponents[k] -= exponents[k] >= kOrder ? kOrder : 0;
    }
    values[root] = sum;
    is_word = is_word && sum == 0;
  }
  return is_word;
}

// The locator of erasures and errors: 0 at the inverse of α^k for each power k of x at which the word is wrong.
Polynomial find_locator(const Polynomial& syndrome, std::size_t roots, std::span<const int> erased) {
  Polynomial locator{1};
  std::size_t degree = 0;
  for (const int place : erased) {
    const Symbol at = power_of_alpha(kOrder - 1 - static_cast<std::size_t>(place));
    for (std::size_t k = ++degree; k > 0; --k)
      locator[k] = static_cast<Symbol>(locator[k] ^ product(at, locator[k - 1]));
  }
  Polynomial before = locator;
  std::size_t length = erased.size();
  for (std::size_t step = erased.size(); step < roots; ++step) {
    Symbol discrepancy = 0;
    for (std::size_t k = 0; k <= std::min(step, length); ++k)
      discrepancy = static_cast<Symbol>(discrepancy ^ product(locator[k], syndrome[step - k]));
    times_x(before);
    if (discrepancy == 0) continue;
    Polynomial next = locator;
    for (std::size_t k = 0; k <= step + 1; ++k)
      next[k] = static_cast<Symbol>(next[k] ^ product(discrepancy, before[k]));
    if (2 * length <= step + erased.size()) {
      length = step + 1 + erased.size() - length;
      for (std::size_t k = 0; k <= step + 1; ++k) before[k] = quotient(locator[k], discrepancy);
    }
    locator = next;
  }
  return locator;
}

}  // namespace

ReedSolomon::ReedSolomon(std::size_t data) : data_(data) {
  require(data >= 1 && data < kLength, "data", data, "1 to 254 symbols");
  const std::size_t roots = kLength - data;
  Polynomial generator{1};
  for (std::size_t root = 0; root < roots; ++root)
    for (std::size_t k = root + 2; k-- > 0;)
      generator[k] = static_cast<Symbol>(product(generator[k], power_of_alpha(root)) ^ (k > 0 ? generator[k - 1] : 0));
  for (std::size_t k = 0; k < roots; ++k) generator_[k] = generator[roots - 1 - k];
}

ReedSolomon::Word ReedSolomon::encode(std::span<const std::uint8_t> data) const {
  require(data.size() == data_, "data", data.size(), std::to_string(data_) + " symbols");
  Word word{};
  std::ranges::copy(data, word.begin());
  const std::span<Symbol> parity(word.begin() + static_cast<std::ptrdiff_t>(data_), word.end());
  for (const Symbol symbol : data) {  // the remainder of a division by the generator
    const auto factor = static_cast<Symbol>(symbol ^ parity[0]);
    for (std::size_t k = 0; k + 1 < parity.size(); ++k)
      parity[k] = static_cast<Symbol>(parity[k + 1] ^ product(factor, generator_[k]));
    parity.back() = product(factor, generator_[parity.size() - 1]);
  }
  return word;
}

bool ReedSolomon::decode(Word& word, std::span<const int> erased) const {
  const std::size_t roots = kLength - data_;
  if (erased.size() > roots) return false;
  Polynomial syndrome{};
  if (syndromes(word, roots, syndrome)) return true;
  const Polynomial locator = find_locator(syndrome, roots, erased);
  const std::size_t degree = degree_of(locator);
  if (degree == 0 || 2 * degree > roots + erased.size()) return false;

  std::array<std::size_t, kOrder> powers{};  // at which the word is wrong
  std::size_t found = 0;
  for (std::size_t power = 0; power < kOrder && found < degree; ++power)  // it has no more roots than its degree
    if (value_at(locator, degree, power_of_alpha(kOrder - power)) == 0) powers[found++] = power;
  if (found != degree) return false;

  Polynomial evaluator{}, derivative{};
  for (std::size_t k = 0; k < degree; ++k)
    for (std::size_t j = 0; j <= k; ++j)
      evaluator[k] = static_cast<Symbol>(evaluator[k] ^ product(locator[j], syndrome[k - j]));
  for (std::size_t k = 1; k <= degree; k += 2) derivative[k - 1] = locator[k];

  Word corrected = word;
  for (const std::size_t power : std::span(powers).first(found)) {
    const Symbol inverse = power_of_alpha(kOrder - power);
    const Symbol slope = value_at(derivative, degree, inverse);
    if (slope == 0) return false;
    const Symbol error = product(power_of_alpha(power), quotient(value_at(evaluator, degree - 1, inverse), slope));
    corrected[kOrder - 1 - power] ^= error;
  }
  if (!syndromes(corrected, roots, syndrome)) return false;
  word = corrected;
  return true;
}

}  // namespace ocisac
