#include "ocisac/light/waveform.hpp"

#include <cmath>
#include <string>
#include <utility>

#include "light/waveform_elements.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr double kMaxLight = 1e300;
constexpr std::size_t kMaxTerms = 4096;

constexpr std::size_t kMaxTones = 8;

void check(const Waveform::Term& term) {
  double peak = std::abs(term.coefficient);
  std::size_t tones = 0;
  std::size_t samples = 0;
  for (const auto& factor : term.factors) {
    peak *= factor->peak();
    tones += factor->cosines().empty() ? 0 : 1;
    samples += factor->has_slopes() ? 1 : 0;
    require(!factor->has_decays() || term.factors.size() == 1, "product", "Chips with rise or fall",
            "such chips times steady light");
  }
  require(samples <= 1, "product", std::to_string(samples) + " factors that are Samples or TriangleWave",
          "one such factor");
  require(tones <= kMaxTones, "product", std::to_string(tones) + " tones", "at most 8 tones");
  require(peak <= kMaxLight, "product", peak, "light of at most 1e300");
}

Waveform::Term multiplied(const Waveform::Term& a, const Waveform::Term& b) {
  Waveform::Term term{a.coefficient * b.coefficient, a.factors};
  term.factors.insert(term.factors.end(), b.factors.begin(), b.factors.end());
  return term;
}

}  // namespace

void require_level(const char* argument, double level) {
  require(std::abs(level) <= kMaxLevel, argument, level, "a finite number from -1e100 to 1e100");
}

Waveform::Waveform(std::vector<Term> terms) : terms_(std::move(terms)) {
  require(terms_.size() <= kMaxTerms, "waveform", terms_.size(),
          "at most 4096 terms once its products are multiplied out");
  for (const Term& term : terms_) check(term);
}

Waveform::Waveform(double level) : terms_{{level, {}}} { require_level("level", level); }
Waveform::Waveform(const Tone& tone) : terms_{{1, {make_element(tone)}}} {}
Waveform::Waveform(const SquareWave& wave) : terms_{{1, {make_element(wave)}}} {}
Waveform::Waveform(const TriangleWave& wave) : terms_{{1, {make_element(wave)}}} {}
Waveform::Waveform(const Chips& chips) : terms_{{1, {make_element(chips)}}} {}
Waveform::Waveform(const Samples& samples) : terms_{{1, {make_element(samples)}}} {}

Waveform operator+(const Waveform& a, const Waveform& b) {
  std::vector<Waveform::Term> terms = a.terms_;
  terms.insert(terms.end(), b.terms_.begin(), b.terms_.end());
  return Waveform(std::move(terms));
}

Waveform operator*(const Waveform& a, const Waveform& b) {
  require(a.terms_.size() * b.terms_.size() <= kMaxTerms, "waveform", a.terms_.size() * b.terms_.size(),
          "at most 4096 terms once its products are multiplied out");
  std::vector<Waveform::Term> terms;
  terms.reserve(a.terms_.size() * b.terms_.size());
  for (const auto& left : a.terms_)
    for (const auto& right : b.terms_) terms.push_back(multiplied(left, right));
  return Waveform(std::move(terms));
}

}  // namespace ocisac
