#include <cstdio>
#include <ocisac/estimation/spectrum.hpp>
#include <ocisac/version.hpp>
#include <vector>

int main() {
  const std::vector<double> signal{1, 2, 3, 4};
  const auto spectrum = ocisac::half_spectra(signal, signal.size());  // through OpenCV's DFT
  std::printf("ocisac %s: mean %g\n", ocisac::version(), spectrum[0].real() / 4);
  return spectrum[0].real() == 10 ? 0 : 1;
}
