#include <cmath>
#include <cstdio>
#include <ocisac/core/version.hpp>
#include <ocisac/tones/find_frequency.hpp>
#include <vector>

int main() {
  std::vector<double> column(240);  // a tone of 30 cycles in 240 rows
  for (std::size_t row = 0; row < column.size(); ++row)
    column[row] = 100 + 50 * std::cos(0.785398163397448 * static_cast<double>(row));
  const double* rows = column.data();
  const ocisac::AnyFramesView frames = ocisac::dense_view(rows, 1, column.size(), 1);
  const auto found = ocisac::find_frequency(frames, {});  // through OpenCV's DFT
  std::printf("ocisac %s: %g cycles per row\n", ocisac::version(), found.frequency);
  return std::abs(found.frequency - 0.125) < 1e-6 ? 0 : 1;
}
