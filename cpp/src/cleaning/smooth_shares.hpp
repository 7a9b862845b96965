// Edge-preserving smoothing of the shares: most edges of the picture are edges of the objects, not of the light.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

namespace ocisac {

// Evidence of a picture, cleaned with the current shares, for a change of them, (rows × columns).
struct ShareEvidence {
  std::vector<double> pull;    // Σ weight·residual·slope
  std::vector<double> weight;  // Σ weight·slope²
};

// Reduces ½·Σ weight·x² − Σ pull·x + λ·Σ √(ε² + |∇(q + x)|²) over changes x of the shares q: their total variation, in
// which edges cost little. Each of the steps, for which evidence is gathered, is one of iteratively reweighted least
// squares. Conjugate gradients solve its
// equations from coarse to fine, on the picture reduced 8, 4 and 2 times and then on its pixels.
void smooth_shares(std::size_t rows, std::size_t columns, const std::function<const ShareEvidence&()>& gather,
                   std::vector<double>& share);

}  // namespace ocisac
