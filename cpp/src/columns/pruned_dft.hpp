// Single lines of the DFT of many columns.
#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// For rows = N₁·N₂ and one line k = k₁ + N₁·k₂, the first step of the transform (decimation in frequency) needs no more
// than its branch k₁: N₂ sums of N₁ rows each, which are added up as the pixels are read. The rest is OpenCV's DFT of
// length N₂, one batch for all columns of a block. Rows of a prime number are transformed whole.
class PrunedDft {
 public:
  // lines: of the DFT of `rows`, 0 … rows − 1.
  PrunedDft(std::size_t rows, std::vector<std::size_t> lines);

  struct Columns {
    std::vector<double> mean, squares;        // (count) linear light; squares: Σ (light − mean)²
    std::vector<std::complex<double>> lines;  // (lines × count) Σ light(n)·e^{−j2πkn/rows}
  };
  // Columns first … first + count of a frame; to: memory that is reused.
  void transform(const AnyFramesView& frames, std::size_t frame, std::size_t first, std::size_t count,
                 const ToneCurve& curve, Columns& to) const;

 private:
  struct Branch {
    std::vector<double> weights;                // (2 × N₁) cosines, −sines
    std::vector<std::complex<double>> twiddle;  // (N₂)
    std::size_t line;                           // k₂
  };

  std::size_t rows_, length_;  // length: N₂
  std::vector<Branch> branches_;
};

}  // namespace ocisac
