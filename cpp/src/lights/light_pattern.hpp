// How a light's box looks in a frame: cells of 2 × 8, their means, and their tone or their common waveform.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <cstddef>
#include <optional>
#include <vector>

#include "ocisac/core/views.hpp"

namespace ocisac {

// A box of a known size, possibly outside of the frame.
struct FreeBox {
  std::ptrdiff_t x = 0, y = 0;
  std::size_t width = 0, height = 0;
};

struct LightPattern {
  std::vector<double> mean;                 // light of the cells, DN
  double noise = 0;                         // standard error of a cell's mean, DN
  std::vector<std::complex<double>> swing;  // of the cells' tone, the upper half of the box first
  std::vector<double> waveform;             // (rows,) of all cells, where the light sends data
  std::optional<double> frequency;          // cycles per row of the waveform's strongest tone
};

// Mean light of cells of columns in every `row_step`-th row of a box. Outside of the frame its edge counts.
class LightCells {
 public:
  LightCells(const FreeBox& box, double dark, std::size_t row_step = 1);

  [[nodiscard]] std::vector<double> light(const AnyFramesView& frame, const FreeBox& box) const;  // (rows × cells)
  [[nodiscard]] const std::vector<std::ptrdiff_t>& rows() const { return rows_; }  // 0: the first of the box
  [[nodiscard]] std::size_t cells() const { return ends_.size(); }

 private:
  double dark_;
  std::vector<std::ptrdiff_t> rows_, columns_;
  std::vector<std::size_t> ends_;  // of the cells, in columns_
};

// Mean and tone of each cell in both halves of the box, by least squares.
class TonePattern {
 public:
  TonePattern(const FreeBox& box, double dark, double frequency);  // cycles per row

  [[nodiscard]] LightPattern pattern_in(const AnyFramesView& frame, const FreeBox& box) const;

 private:
  struct Rows {                      // of a half
    std::size_t first;               // of the rows taken
    Eigen::MatrixXd waves, weights;  // (rows × 3): 1, cosine, sine, and their weights
  };
  [[nodiscard]] std::vector<double> fit(const std::vector<double>& light) const;  // (parts × waves × cells)
  [[nodiscard]] double noise(const std::vector<double>& light, const std::vector<double>& fitted) const;

  LightCells cells_;
  std::vector<Rows> parts_;
  double spread_ = 0;  // standard error of a cell's mean over that of a row
};

// The waveform that all cells have in common, beside slow light.
class WaveformPattern {
 public:
  WaveformPattern(const FreeBox& box, double dark);

  [[nodiscard]] LightPattern pattern_in(const AnyFramesView& frame, const FreeBox& box) const;

 private:
  LightCells cells_;
  Eigen::MatrixXd slow_;  // (rows × terms), orthonormal
};

}  // namespace ocisac
