#include <cstdint>

#include "kernel_cases.hpp"
#include "lights/screening_kernels.hpp"

namespace kernel_cases {

namespace {

using namespace ocisac::kernels;

// Moments in the first five sections of `out`, `common` in the others.
Chunk chunk_in(const float* rows, float* out, std::size_t stride) {
  return {rows, out, out + stride, out + 2 * stride, out + 3 * stride, out + 4 * stride, out + 5 * stride};
}

// As chunk_moments().
void plain_moments(const float* rows, std::size_t stride, std::size_t groups, std::size_t tile, float* out) {
  const Chunk moments = chunk_in(rows, out, stride);
  for (std::size_t g = 0; g < groups; ++g) {
    double sum = 0, slope = 0, square = 0, next = 0, second = 0;
    for (std::size_t n = 0; n < kChunkRows; ++n) {
      const auto at = [&](std::size_t i) { return double{rows[n * stride + i]} - double{rows[i]}; };
      const double x = at(g);
      sum += x, slope += static_cast<double>(n) * x, square += x * x, next += x * at(g + 1), second += x * at(g + 2);
      double all = 0;
      for (std::size_t k = 0; k < tile; ++k) all += n == 0 ? 0 : at(g + k);
      moments.common[n * stride + g] = static_cast<float>(all);
    }
    moments.sum[g] = static_cast<float>(sum), moments.slope[g] = static_cast<float>(slope);
    moments.square[g] = static_cast<float>(square);
    moments.next[g] = static_cast<float>(next), moments.second[g] = static_cast<float>(second);
  }
}

KernelCase moments_case(std::size_t groups, std::size_t tile) {
  const std::size_t stride = groups + kChunkPadding;
  const auto rows = std::make_shared<Misaligned<float>>(random_rows<float>(kChunkRows, groups, stride, 5, 0.3));
  const auto run = [=](bool plain, float* out) {
    if (plain) return plain_moments(rows->data(), stride, groups, tile, out);
    chunk_moments(stride, groups, tile, chunk_in(rows->data(), out, stride));
  };
  const std::string size = std::to_string(groups) + " groups";
  return kernel_case<float>("chunk_moments " + size + ", tiles of " + std::to_string(tile), 1e-5,
                            {5 + kChunkRows, groups, stride}, run, groups > 200);
}

// Rows of two chunks, and their moments.
struct Window {
  std::size_t stride;
  Misaligned<float> rows, moments[2], scratch;

  Window(std::size_t groups, std::size_t held)
      : stride(groups + kChunkPadding),
        rows(random_rows<float>(2 * kChunkRows, held, stride, 5, 0.3)),
        moments{Misaligned<float>((5 + kChunkRows) * stride), Misaligned<float>((5 + kChunkRows) * stride)},
        scratch(6 * stride) {
    for (std::size_t half = 0; half < 2; ++half)
      plain_moments(rows.data() + half * kChunkRows * stride, stride, groups, 1, moments[half].data());
  }
  [[nodiscard]] Chunk chunk(std::size_t half) {
    return chunk_in(rows.data() + half * kChunkRows * stride, moments[half].data(), stride);
  }
  [[nodiscard]] WindowScratch room() {
    float* at = scratch.data();
    return {at, at + stride, at + 2 * stride, at + 3 * stride, at + 4 * stride, at + 5 * stride};
  }
};

// Computed from the rows in float64. `out`: energies, followed by 1 if there is a candidate.
void plain_energies(const Window& window, std::size_t tiles, const TileBound& bound, float* out) {
  constexpr std::size_t rows = 2 * kChunkRows;
  const auto product = [&](std::size_t g, std::size_t h) {  // after removal of mean and slope
    double both = 0, sums[2] = {0, 0}, slopes[2] = {0, 0};
    for (std::size_t n = 0; n < rows; ++n) {
      const double x[2] = {window.rows.data()[n * window.stride + g], window.rows.data()[n * window.stride + h]};
      both += x[0] * x[1];
      for (int k = 0; k < 2; ++k) sums[k] += x[k], slopes[k] += x[k] * (static_cast<double>(n) - 15.5);
    }
    return both - sums[0] * sums[1] / rows - slopes[0] * slopes[1] / double{bound.slope_energy};
  };
  bool any = false;
  for (std::size_t g = 0; g < tiles; ++g) {
    double all = 0, common = 0;
    for (std::size_t i = 0; i < bound.groups; ++i) {
      all += product(g + i, g + i);
      for (std::size_t k = 0; k < i; ++k) common += product(g + i, g + k);
    }
    const bool candidate = all > double{bound.min_energy} &&
                           all + 2 * common >= double{bound.min_share} * static_cast<double>(bound.groups) * all;
    out[g] = candidate ? static_cast<float>(all) : 0.0F;
    any = any || candidate;
  }
  out[tiles + kChunkPadding] = any ? 1 : 0;
}

KernelCase energies_case(std::size_t tiles, std::size_t tile) {
  // Moments of the last groups include two more, as in a wider picture.
  const auto window = std::make_shared<Window>(tiles + tile - 1, tiles + tile + 1);
  const std::size_t stride = tiles + kChunkPadding;
  const auto run = [=](bool plain, float* out) {
    const TileBound bound{tile, 2.5F * static_cast<float>(tile), tile == 1 ? 0.5F : 0.4F, 2728};
    if (plain) return plain_energies(*window, tiles, bound, out);
    const bool any = tile_energies(window->chunk(0), window->chunk(1), tiles, bound, window->room(), out);
    out[stride] = any ? 1 : 0;
    std::fill_n(out + tiles, kChunkPadding, filler<float>());  // may be written
  };
  return kernel_case<float>("tile_energies " + std::to_string(tiles) + " tiles of " + std::to_string(tile), 2e-5,
                            {1, stride + 1, stride + 1}, run, tiles > 200);
}

KernelCase waves_case(std::size_t waves, std::size_t stride) {
  struct Input {
    Misaligned<float> rows, cosine, sine;
  };
  const auto input = std::make_shared<Input>(Input{random_rows<float>(2 * kChunkRows, 1, stride, 3),
                                                   random_rows<float>(kChunkRows, waves, waves),
                                                   random_rows<float>(kChunkRows, waves, waves)});
  const auto run = [=](bool plain, float* out) {
    const float* earlier = input->rows.data();
    const float* later = earlier + kChunkRows * stride;
    const float step = 0.75F;
    if (!plain)
      return wave_sums(earlier, later, step, stride, input->cosine.data(), input->sine.data(), waves, out, out + waves);
    for (std::size_t k = 0; k < waves; ++k) {
      double even = 0, odd = 0;
      for (std::size_t n = 0; n < kChunkRows; ++n) {
        const double before = earlier[n * stride], after = double{later[(15 - n) * stride]} + double{step};
        even += double{input->cosine.data()[n * waves + k]} * (after + before);
        odd += double{input->sine.data()[n * waves + k]} * (after - before);
      }
      out[k] = static_cast<float>(even), out[waves + k] = static_cast<float>(odd);
    }
  };
  return kernel_case<float>("wave_sums " + std::to_string(waves) + " waves, stride " + std::to_string(stride), 1e-5,
                            {2, waves, waves}, run, waves > 200);
}

KernelCase eight_bytes_case(std::size_t groups) {
  const auto row =
      std::make_shared<Misaligned<std::uint8_t>>(random_rows<std::uint8_t>(1, 8 * groups, 8 * groups, 128, 90));
  const auto run = [=](bool plain, float* out) {
    if (!plain) return sum_eight_bytes(row->data(), groups, 0.125F, 16, out);
    for (std::size_t g = 0; g < groups; ++g) {
      int sum = 0;
      for (std::size_t k = 0; k < 8; ++k) sum += row->data()[8 * g + k];
      out[g] = static_cast<float>(sum) * 0.125F - 16;
    }
  };
  return kernel_case<float>("sum_eight_bytes " + std::to_string(groups) + " groups", 1e-6, {1, groups, groups}, run,
                            groups > 200);
}

}  // namespace

std::vector<KernelCase> screening_cases() {
  std::vector<KernelCase> cases;
  const auto add = [&](std::size_t length) {
    for (const std::size_t tile : {1u, 2u, 3u}) {
      cases.push_back(moments_case(length, tile));
      cases.push_back(energies_case(length, tile));
    }
    cases.push_back(eight_bytes_case(length));
  };
  for (const std::size_t length : kLengths) add(length);
  add(240);  // groups of a frame of 1920 columns
  for (const std::size_t waves : {8u, 16u, 24u, 240u})
    for (const std::size_t stride : {1u, 75u}) cases.push_back(waves_case(waves, stride));
  return cases;
}

}  // namespace kernel_cases
