// Frequency response of the exposure.
#pragma once

#include <complex>

namespace ocisac {

// sin(πx)/(πx), signed, 1 at 0; exact zeros at the other whole numbers.
double sinc(double x);

// x of 0 … 1 with sinc(x) = gain.
double exposure_cycles_of_gain(double gain);

// H(f) = sinc(f·T_e)·e^{−jπ f T_e}: the response of a box of length `exposure` (s) that ends at the sampling instant.
std::complex<double> exposure_response(double frequency, double exposure);

}  // namespace ocisac
