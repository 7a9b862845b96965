#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "ocisac/chips/detect_chips.hpp"
#include "ocisac/chips/sequence_detector.hpp"

namespace {

// Random chips, and the rows that depend on them only.
struct Frame {
  std::vector<double> chips, rows;
  ocisac::ChipQuestion question;

  Frame(double rows_per_chip, double exposure, double noise, std::size_t count, unsigned seed, double shorter = 1)
      : question{{}, {rows_per_chip, -0.5 * exposure - 0.37, exposure}, std::max(noise, 1e-3), 0, count} {
    question.clock.shorter = shorter;
    question.clock.later = shorter < 1 ? 4.3 : 0;
    question.clock.long_row = 1;
    std::mt19937 random(seed);
    for (std::size_t k = 0; k < count; ++k) chips.push_back(static_cast<double>(random() & 1U));
    rows.resize(static_cast<std::size_t>(static_cast<double>(count) * rows_per_chip - exposure - 0.37));
    ocisac::expose_chips({chips, 0}, question.clock, rows);
    for (double& row : rows) row += noise * std::normal_distribution<double>(0, 1)(random);
    question.rows = rows;
  }
};

double squares_of(const Frame& frame, const std::vector<double>& chips) {
  std::vector<double> rows(frame.rows.size());
  ocisac::expose_chips({chips, 0}, frame.question.clock, rows);
  double squares = 0;
  for (std::size_t n = 0; n < rows.size(); ++n)
    squares += std::pow(frame.question.clock.share_at(static_cast<std::ptrdiff_t>(n)) * (frame.rows[n] - rows[n]), 2);
  return squares;
}

}  // namespace

TEST_CASE("the likelihood ratios are those of all sequences, known chips counted in") {
  constexpr std::size_t kChips = 11;
  const std::vector<double> known{1, 0, 1};
  for (const bool some_known : {false, true})
    for (const double exposure : {0.0, 1.3, 2.0, 7.7, 12.2})
      for (unsigned seed = 0; seed < 5; ++seed) {
        Frame frame(3.3, exposure, 0.1, kChips, seed, seed % 2 == 0 ? 1.0 : 0.4);
        if (some_known) frame.question.known = {known, 4};
        CAPTURE(some_known);
        CAPTURE(exposure);
        CAPTURE(seed);
        double best[kChips][2];
        for (auto& of_chip : best) of_chip[0] = of_chip[1] = std::numeric_limits<double>::infinity();
        std::vector<double> chips(kChips);
        for (unsigned word = 0; word < 1U << kChips; ++word) {
          for (std::size_t k = 0; k < kChips; ++k) chips[k] = (word >> k) & 1U;
          double nats = squares_of(frame, chips) / (2 * 0.1 * 0.1);
          for (std::size_t k = 0; some_known && k < known.size(); ++k)
            nats += 0.5 * ocisac::kKnownPrecision * std::abs(chips[4 + k] - known[k]);
          for (std::size_t k = 0; k < kChips; ++k) {
            double& least = best[k][(word >> k) & 1U];
            least = std::min(least, nats);
          }
        }
        const auto found = ocisac::detect_sequence(frame.question);
        const auto everything =
            ocisac::search_reduced(ocisac::ChipEquations(frame.question, 24), {1U << 20U, 1U << 20U, 1e9});
        for (std::size_t k = 0; k < kChips; ++k) {
          CHECK(found[k] == doctest::Approx(best[k][0] - best[k][1]).epsilon(1e-4));
          CHECK(std::abs(everything[k] - found[k]) <= 1e-3 * (1 + std::abs(found[k])));
          if (some_known && k >= 4 && k < 7) CHECK((found[k] > 0) == (known[k - 4] > 0.5));
        }
      }
}
