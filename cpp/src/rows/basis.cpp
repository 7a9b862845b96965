#include "ocisac/rows/basis.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>

#include "core/legendre.hpp"
#include "core/levels.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kTurns = 64;  // of one phasor

// cos and sin of 0 … 63 turns, as products of two fewer ones.
struct Turns {
  std::array<double, kTurns> cosine{1}, sine{};

  explicit Turns(const Phasor& one) {
    cosine[1] = one.cosine, sine[1] = one.sine;
    for (std::size_t k = 2; k < kTurns; ++k) {
      const std::size_t a = k / 2, b = k - a;
      cosine[k] = cosine[a] * cosine[b] - sine[a] * sine[b];
      sine[k] = sine[a] * cosine[b] + cosine[a] * sine[b];
    }
  }
};

std::span<double> appended(std::vector<double>& basis, std::size_t values) {
  basis.resize(basis.size() + values);
  return std::span(basis).last(values);
}

// visit(first row, times, their first edge, length from edge to edge) for each frame.
template <class Visit>
void for_each_frame(const RowSampling& rows, Visit visit) {
  const std::size_t height = rows.times.size() / rows.frames;
  for (std::size_t frame = 0; frame < rows.frames; ++frame) {
    const auto times = std::span(rows.times).subspan(frame * height, height);
    const double apart = height > 1 ? (times.back() - times.front()) / static_cast<double>(height - 1) : 1;
    visit(frame * height, times, times.front() - 0.5 * apart, times.back() - times.front() + apart);
  }
}

// Multiplies the column that (degree + 1) columns begin with by weights and polynomials.
void spread(const RowSampling& rows, std::size_t degree, std::span<double> columns) {
  if (degree == 0 && rows.weights.empty()) return;
  const std::size_t count = rows.times.size();
  std::vector<double> polynomials(degree + 1, 1.0);
  for_each_frame(rows, [&](std::size_t first, std::span<const double> times, double begin, double length) {
    for (std::size_t i = 0; i < times.size(); ++i) {
      const std::size_t row = first + i;
      if (degree > 0) legendre(2 * (times[i] - begin) / length - 1, polynomials);
      const double value = columns[row] * (rows.weights.empty() ? 1 : rows.weights[row]);
      for (std::size_t d = 0; d <= degree; ++d) columns[d * count + row] = value * polynomials[d];
    }
  });
}

void expose(const RowSampling& rows, double frequency, std::span<double> cosine, std::span<double> sine) {
  double response = 1;
  for (std::size_t row = 0; row < rows.exposures.size(); ++row) {
    if (row == 0 || rows.exposures[row] != rows.exposures[row - 1]) response = sinc(frequency * rows.exposures[row]);
    cosine[row] *= response;
    sine[row] *= response;
  }
}

}  // namespace

RowSampling centred_rows(std::size_t rows) {
  RowSampling sampling{std::vector<double>(rows)};
  for (std::size_t n = 0; n < rows; ++n)
    sampling.times[n] = static_cast<double>(n) - (static_cast<double>(rows) - 1) / 2;
  return sampling;
}

void append_course(std::vector<double>& basis, const RowSampling& rows, std::span<const double> course,
                   std::size_t degree) {
  require(course.empty() || course.size() == rows.times.size(), "course", course.size(), "a value for each row");
  const auto columns = appended(basis, (degree + 1) * rows.times.size());
  std::fill_n(columns.begin(), rows.times.size(), 1.0);
  std::ranges::copy(course, columns.begin());
  spread(rows, degree, columns);
}

void append_trend(std::vector<double>& basis, const RowSampling& rows, std::size_t degree) {
  append_course(basis, rows, {}, degree);
}

void append_slow_light(std::vector<double>& basis, const RowSampling& rows, std::size_t terms) {
  std::vector<double> times(rows.times.size()), sine(times.size());
  for (std::size_t k = 1; k <= terms; ++k) {
    const auto column = appended(basis, rows.times.size());
    for_each_frame(rows, [&](std::size_t first, std::span<const double> own, double begin, double length) {
      const auto from_edge = std::span(times).subspan(first, own.size());
      std::ranges::transform(own, from_edge.begin(), [&](double time) { return time - begin; });
      fill_wave(from_edge, 0.5 * static_cast<double>(k) / length, column.subspan(first, own.size()),
                std::span(sine).subspan(first, own.size()));
    });
    spread(rows, 0, column);
  }
}

void append_tones(std::vector<double>& basis, const RowSampling& rows, std::span<const double> frequencies,
                  std::size_t degree) {
  const std::size_t count = rows.times.size(), room = (degree + 1) * count;
  basis.reserve(basis.size() + 2 * room * frequencies.size());
  for (const double frequency : frequencies) {
    const auto both = appended(basis, 2 * room);
    const auto cosine = both.first(count), sine = both.subspan(room, count);
    fill_wave(rows.times, frequency, cosine, sine);
    expose(rows, frequency, cosine, sine);
    spread(rows, degree, both.first(room));
    spread(rows, degree, both.last(room));
  }
}

Phasor phasor(double cycles, double time) {
  const double product = cycles * time;
  const double rest = std::fma(cycles, time, -product);
  const double angle = kTwoPi * ((product - std::nearbyint(product)) + rest);
  return {std::cos(angle), std::sin(angle)};
}

void fill_wave(std::span<const double> times, double cycles, std::span<double> cosine, std::span<double> sine) {
  const double step = times.size() > 1 ? times[1] - times[0] : 0;
  const Turns turns(phasor(cycles, step));
  for (std::size_t begin = 0; begin < times.size(); begin += kTurns) {
    const std::size_t end = std::min(begin + kTurns, times.size());
    std::uint64_t uneven = 0;  // bits in which steps differ: compilers make vectors of that
    for (std::size_t n = begin + 1; n < end; ++n)
      uneven |= std::bit_cast<std::uint64_t>(times[n] - times[n - 1]) ^ std::bit_cast<std::uint64_t>(step);
    const Phasor first = phasor(cycles, times[begin]);
    for (std::size_t n = begin; n < end; ++n) {
      const double c = turns.cosine[n - begin], s = turns.sine[n - begin];
      cosine[n] = first.cosine * c - first.sine * s;
      sine[n] = first.sine * c + first.cosine * s;
    }
    for (std::size_t n = begin; uneven != 0 && n < end; ++n) {
      const Phasor at = phasor(cycles, times[n]);
      cosine[n] = at.cosine;
      sine[n] = at.sine;
    }
  }
}

}  // namespace ocisac
