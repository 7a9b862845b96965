#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "ocisac/chips/detect_chips.hpp"
#include "ocisac/chips/error_rates.hpp"
#include "ocisac/chips/sequence_detector.hpp"

namespace {

struct Frame {
  std::vector<double> chips, rows;
  ocisac::ChipQuestion question;

  Frame(double rows_per_chip, double length, double noise, std::size_t frame_rows, unsigned seed) {
    std::mt19937 random(seed);
    const double exposure = length * rows_per_chip;
    const auto before = static_cast<std::ptrdiff_t>(std::ceil(0.5 * length)) + 1;
    const auto count = static_cast<std::size_t>(static_cast<double>(frame_rows) / rows_per_chip + length) + 4;
    for (std::size_t k = 0; k < count; ++k) chips.push_back(static_cast<double>(random() & 1U));
    const double phase = std::uniform_real_distribution<double>(0, rows_per_chip)(random);
    question = {{}, {rows_per_chip, phase, exposure}, noise, -before, count};
    rows.resize(frame_rows);
    ocisac::expose_chips({chips, question.first}, question.clock, rows);
    for (double& row : rows) row += noise * std::normal_distribution<double>(0, 1)(random);
    question.rows = rows;
  }
  Frame(const Frame&) = delete;
  Frame& operator=(const Frame&) = delete;

  // Errors among chips at least `exposures` exposures from the ends.
  struct Count {
    std::size_t wrong = 0, chips = 0;
  };
  [[nodiscard]] Count errors(std::string_view method, double exposures) const {
    const auto found = ocisac::detect_chips(question, method).llr;
    const double away = exposures * question.clock.exposure_rows + question.clock.rows_per_chip;
    Count result;
    for (std::size_t k = 0; k < chips.size(); ++k) {
      const double begin = question.clock.phase + (static_cast<double>(question.first) + static_cast<double>(k)) *
                                                      question.clock.rows_per_chip;
      if (begin < away || begin + away + question.clock.rows_per_chip > static_cast<double>(rows.size())) continue;
      ++result.chips;
      result.wrong += (found[k] > 0) != (chips[k] > 0.5);
    }
    return result;
  }
};

double share_of_errors(std::string_view method, double rows_per_chip, double length, double noise, unsigned frames,
                       double exposures) {
  Frame::Count sum;
  for (unsigned seed = 0; seed < frames; ++seed) {
    const auto one = Frame(rows_per_chip, length, noise, 1080, seed).errors(method, exposures);
    sum.wrong += one.wrong;
    sum.chips += one.chips;
  }
  return static_cast<double>(sum.wrong) / static_cast<double>(sum.chips);
}

}  // namespace

TEST_CASE("the reduced search finds the most likely sequence, with the same certainty of doubtful chips") {
  std::size_t doubtful = 0;
  for (unsigned seed = 0; seed < 6; ++seed) {
    const Frame frame(2.1, 7.3, 0.04, 540, seed);
    const auto found = ocisac::detect_chips(frame.question, "reduced").llr;
    const auto all = ocisac::detect_sequence(frame.question);
    for (std::size_t k = 20; k + 20 < all.size(); ++k) {
      CHECK((found[k] > 0) == (all[k] > 0));
      if (std::abs(all[k]) > 5) continue;
      ++doubtful;
      CHECK(found[k] == doctest::Approx(all[k]).epsilon(0.05));
    }
  }
  CHECK(doubtful > 5);
}

TEST_CASE("chips of which only one kind was kept have the certainty of the nearest other sequence") {
  std::size_t sure = 0, alike = 0;
  for (const double length : {0.6, 1.9, 4.4, 7.3})
    for (unsigned seed = 0; seed < 3; ++seed) {
      const Frame frame(3.1, length, 0.02, 540, seed);
      const auto found = ocisac::detect_chips(frame.question, "reduced").llr;
      const auto all = ocisac::detect_sequence(frame.question);
      CAPTURE(length);
      for (std::size_t k = 20; k + 20 < all.size(); ++k) {
        if (std::abs(all[k]) < 12) continue;
        ++sure;
        alike += std::abs(found[k] - all[k]) < 0.02 * std::abs(all[k]);
        CHECK(found[k] / all[k] > 0.98);  // a single other sequence gives an upper bound
      }
    }
  CHECK(sure > 1000);
  CHECK(static_cast<double>(alike) > 0.8 * static_cast<double>(sure));
}

TEST_CASE("the cheapest detector that is right is taken; much noise is no reason to slice an exposure of many chips") {
  const auto chosen = [](double rows_per_chip, double length, double noise) {
    return ocisac::detect_chips(Frame(rows_per_chip, length, noise, 300, 1).question).method;
  };
  CHECK(chosen(4, 0.5, 0.04) == "slicer");
  CHECK(chosen(7, 1, 0.02) == "slicer");
  CHECK(chosen(4, 1.2, 0.3) == "reduced");
  CHECK(chosen(4, 7, 0.02) == "reduced");
  CHECK(chosen(4, 7, 2.0) == "reduced");
}

TEST_CASE("exposures of 14 and of 20 chips are read without an error at little noise") {
  for (unsigned seed = 0; seed < 3; ++seed) {
    CHECK(Frame(4.3, 14, 0.01, 1080, seed).errors("auto", 0.5).wrong == 0);
    CHECK(Frame(7.1, 20.4, 0.005, 2160, seed).errors("auto", 0.5).wrong == 0);
  }
}

TEST_CASE("detectors make the errors that are foretold") {
  struct Case {
    double rows_per_chip, length, noise;
  };
  for (const Case& one : {Case{2.13, 1.2, 0.2}, Case{4.07, 2.3, 0.2}, Case{3.3, 5.2, 0.08}}) {
    const auto predicted = ocisac::detector_error_rates(one.rows_per_chip, one.length * one.rows_per_chip, one.noise);
    const auto measured = [&](std::string_view method) {
      return share_of_errors(method, one.rows_per_chip, one.length, one.noise, 30, 3);
    };
    CAPTURE(one.length);
    CHECK(measured("slicer") == doctest::Approx(predicted.slicer).epsilon(0.15));
    CHECK(measured("inverse") == doctest::Approx(predicted.inverse).epsilon(0.25));
    CHECK(measured("wiener") == doctest::Approx(predicted.wiener).epsilon(0.15));
    CHECK(measured("dfe") > 0.8 * predicted.dfe);  // error propagation is not included
    const double most_likely = measured("mlse");
    CHECK(most_likely < 1.3 * predicted.mlse);
    CHECK(most_likely > 0.4 * predicted.mlse);
  }
}

TEST_CASE("the slicer is not taken where chips slide past the rows") {
  for (unsigned seed = 0; seed < 8; ++seed) {
    const double rows_per_chip = 1 + 0.002 * (seed - 3.5);
    CHECK(Frame(rows_per_chip, 1, 0.02, 1080, seed).errors("auto", 1).wrong == 0);
  }
}

TEST_CASE("a value with more others than can be tried has the error rate of all their signs") {
  const std::vector<double> others{0.3, -0.2, 0.15, 0.1, -0.08, 0.07, 0.05, 0.04, 0.03, 0.02, 0.01};
  double sum = 0;
  for (unsigned word = 0; word < 1U << others.size(); ++word) {
    double value = 0.5;
    for (std::size_t j = 0; j < others.size(); ++j) value += ((word >> j) & 1U ? 0.5 : -0.5) * others[j];
    sum += 0.5 * std::erfc(value / 0.12 / std::sqrt(2.0));
  }
  CHECK(ocisac::sliced_error_rate(1, others, 0.12) == doctest::Approx(sum / 2048).epsilon(1e-9));
}

TEST_CASE("questions without meaning are refused by every detector") {
  for (const auto method : ocisac::detector_names()) {
    Frame frame(4, 8, 0.1, 100, 1);
    frame.question.noise = 0;
    CHECK_THROWS_WITH_AS(ocisac::detect_chips(frame.question, method), doctest::Contains("noise: got 0"),
                         std::invalid_argument);
    frame.question.noise = 0.1;
    frame.question.clock.exposure_rows = 100;
    CHECK_THROWS_WITH_AS(ocisac::detect_chips(frame.question, method), doctest::Contains("exposure_rows: got 100"),
                         std::invalid_argument);
    frame.question.clock.exposure_rows = 8;
    frame.question.count = 0;
    CHECK(ocisac::detect_chips(frame.question, method).llr.empty());
    frame.question.count = 30;
    frame.question.rows = {};
    for (const double ratio : ocisac::detect_chips(frame.question, method).llr) CHECK(ratio == 0);
    if (method == "mlse") continue;
    frame.question.clock.exposure_rows = 4 * 23.9;  // bounded by the number of sequences kept
    CHECK(ocisac::detect_chips(frame.question, method).llr.size() == 30);
  }
  CHECK_THROWS_WITH_AS(ocisac::detect_chips(Frame(4, 8, 0.1, 100, 1).question, "best"),
                       doctest::Contains("method: got best"), std::invalid_argument);
}
