// Columns of the linear model of a row signal: slow light, tones and known courses, as the rows see them.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace ocisac {

// Rows of one frame, or of several with as many rows each. Unit: row times; frequencies are in cycles per row.
struct RowSampling {
  std::vector<double> times;        // (rows) middles of the exposures
  std::vector<double> exposures{};  // (rows); empty: 0
  std::vector<double> weights{};    // (rows) by which all columns are multiplied; empty: 1
  std::size_t frames = 1;
};

// One frame whose rows are read evenly. Times count from the middle row, which makes sines and cosines orthogonal.
RowSampling centred_rows(std::size_t rows);

// A basis is (rows × columns), dense, column by column; every function appends its columns.

// Legendre polynomials of degrees 0 to `degree` over each frame, −1 … 1 from the edge of its first row to that of its
// last one.
void append_trend(std::vector<double>& basis, const RowSampling& rows, std::size_t degree);

// Slow light: cos(πk·p), k = 1 … terms, where p = 0 … 1 over each frame.
void append_slow_light(std::vector<double>& basis, const RowSampling& rows, std::size_t terms);

// For each frequency f the polynomials up to `degree` times cos(2πft), then times sin(2πft), both through the exposure.
void append_tones(std::vector<double>& basis, const RowSampling& rows, std::span<const double> frequencies,
                  std::size_t degree = 0);

// A known course, (rows), such as that of exposed chips, times the polynomials up to `degree`; empty: 1.
void append_course(std::vector<double>& basis, const RowSampling& rows, std::span<const double> course,
                   std::size_t degree);

// cos and sin of 2π·cycles·time with the whole cycles taken off exactly before rounding.
struct Phasor {
  double cosine, sine;
};
Phasor phasor(double cycles, double time);

// The same at each time, by turns from row to row where rows are read evenly: exact to some 10⁻¹⁵.
void fill_wave(std::span<const double> times, double cycles, std::span<double> cosine, std::span<double> sine);

}  // namespace ocisac
