#include "lights/refinement.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numeric>

#include "lights/own_pixels.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

using Complex = std::complex<double>;

constexpr double kSettledFrequency = 0.02;  // relative change in a round
// Amplitude at the box's edges, relative to the largest. Under a window of two cycles a sharp edge has one half.
constexpr double kWholeBox = 0.15;
constexpr std::size_t kTiltGroups = 3;

constexpr std::size_t kMaxOrders = 9;  // of a periodic light's harmonics

// Magnitude without the standard's scaling for extreme exponents.
double size(Complex z) { return std::sqrt(std::norm(z)); }

// Calls visit(index, row) for every element of a part of the patch.
template <class Visit>
void for_each(const Patch& patch, const Region& range, Visit visit) {
  for (std::size_t n = range.y; n < range.bottom(); ++n)
    for (std::size_t g = range.x; g < range.right(); ++g) visit(n * patch.stride + g, n);
}

// Groups that swing with the strongest ones of `core`, another lamp on the same rows excluded: Re Σ_n s(n)·r*(n) over
// Σ_n |s(n)|·|r(n)| of the swings s and r is 1 where they have one phase in all rows, near 0 where the frequency
// differs by a cycle or more over them. Over the rows of a tile a tone of its frequency keeps its phase to half a turn.
// Reference: the strongest group, then the sum of those that swing with it.
std::vector<std::uint8_t> coherent_groups(const Patch& patch, const ComplexValues& swing, const Region& core) {
  std::vector<Complex> sums(patch.groups);
  for_each(patch, core, [&](std::size_t i, std::size_t n) { sums[i - n * patch.stride] += swing[i]; });
  std::vector<std::uint8_t> coherent(patch.groups);
  coherent[static_cast<std::size_t>(std::ranges::max_element(sums, {}, size) - sums.begin())] = 1;
  for (int round = 0; round < 2; ++round) {
    std::vector<double> products(patch.groups), sizes(patch.groups);
    for (std::size_t n = 0; n < patch.rows; ++n) {
      Complex reference = 0;
      for (std::size_t g = core.x; g < core.right(); ++g)
        if (coherent[g]) reference += swing[n * patch.stride + g];
      const double c = reference.real(), s = reference.imag(), length = size(reference);
      for (std::size_t g = 0; g < patch.groups; ++g) {
        const std::size_t i = n * patch.stride + g;
        products[g] += swing.real[i] * c + swing.imaginary[i] * s;
        sizes[g] += length * size(swing[i]);
      }
    }
    for (std::size_t g = 0; g < patch.groups; ++g) coherent[g] = products[g] > kMostly * sizes[g];
  }
  return coherent;
}

// The light's box and the amplitude of |z| near its maximum. The box is the connected part of largest total swing that
// begins in the suspect's, in columns that swing together. `clear`: where the suspect's tone is clearest.
std::optional<RefinedLight> lit_box(const Patch& patch, const ComplexValues& swing, const Region& suspect,
                                    const Region& clear, double edge) {
  const Region clearest = patch.range(clear);
  if (clearest.pixels() == 0) return {};
  const auto coherent = coherent_groups(patch, swing, clearest);
  const Region where = patch.range(suspect);
  if (where.pixels() == 0) return {};
  Complex sum = 0;
  std::vector<double> sizes;
  sizes.reserve(where.pixels());
  for_each(patch, where, [&](std::size_t i, std::size_t n) {
    if (!coherent[i - n * patch.stride]) return;
    const double length = size(swing[i]);
    sum += length * swing[i];
    sizes.push_back(length);
  });
  if (sizes.empty()) return {};
  const auto high = sizes.begin() + static_cast<std::ptrdiff_t>((sizes.size() - 1) * 98 / 100);
  std::ranges::nth_element(sizes, high);
  const double largest = *high;
  if (!(largest > 0) || sum == Complex(0)) return {};
  const Complex phase = sum / std::abs(sum);
  const double least = edge * largest, c = phase.real(), s = phase.imag();
  std::vector<double> aligned(swing.real.size());
  std::vector<std::uint8_t> open_to(aligned.size());
  for (std::size_t n = 0; n < patch.rows; ++n)
    for (std::size_t g = 0; g < patch.groups; ++g) {
      const std::size_t i = n * patch.stride + g;
      const double a = swing.real[i], b = swing.imaginary[i], along = a * c + b * s;
      aligned[i] = along;
      open_to[i] = static_cast<std::uint8_t>((along > least) & (along * along > kMostly * kMostly * (a * a + b * b)) &
                                             coherent[g]);
    }
  Region best;
  double most = 0;
  for_each(patch, where, [&](std::size_t i, std::size_t n) {
    if (!open_to[i]) return;
    Region part{i - n * patch.stride, n, 1, 1};
    double weight = 0;
    visit_connected(
        i, patch.stride, open_to, [](auto...) { return true; },
        [&](std::size_t at, const Region& place) {
          weight += aligned[at];
          part = hull(part, place);
        });
    if (weight > most) most = weight, best = part;
  });
  if (most == 0) return {};
  return RefinedLight{.box = {patch.first_column + best.x * patch.group, patch.first_row + best.y,
                              best.width * patch.group, best.height},
                      .amplitude = largest};
}

// Light multiplies a picture, so the texture of log light is equal in bright and dark rows. Lines of text have texture
// only in the rows of their letters.
double uneven_variance(const Patch& patch, const Region& core, const std::vector<double>& fast, double frequency) {
  const PatchArray own = patch.part_of(fast, core);
  const Eigen::ArrayXd sums = own.rowwise().sum();
  const Eigen::ArrayXd variances =
      (own.square().rowwise().sum() - sums.square() / static_cast<double>(core.width)).max(0.0);
  Complex tone = 0;
  for (Eigen::Index n = 0; n < variances.size(); ++n) tone += variances(n) * turned(frequency * static_cast<double>(n));
  return variances.sum() > 0 ? std::abs(tone) / variances.sum() : 0;
}

// Profile weighted with the local swing of log light, in the box and two cycles on each side.
Profile profile_of(const Patch& patch, const kernels::HannWindow& window, const Region& box, double frequency) {
  const ComplexValues swing = swing_of(patch, patch.logs, window);
  const std::vector<double> fast = fast_logs(patch, hann_length(frequency));
  const auto cycle = static_cast<std::size_t>(std::lround(1 / frequency));
  const Region core = patch.range(box), wide = patch.range(widened(box, 2 * cycle));
  Complex sum = 0;
  for_each(patch, core, [&](std::size_t i, std::size_t) { sum += swing[i]; });
  const Complex phase = sum == Complex(0) ? Complex(1) : sum / std::abs(sum);
  Profile profile;
  profile.matched.resize(patch.rows), profile.weight.resize(patch.rows), profile.even.resize(patch.rows);
  const auto weight = [&, c = phase.real(), s = phase.imag()](std::size_t i) {
    return std::max(swing.real[i] * c + swing.imaginary[i] * s, 0.0);
  };
  for_each(patch, wide, [&](std::size_t i, std::size_t row) {
    const double w = weight(i);
    profile.matched[row] += w * fast[i];
    profile.weight[row] += w * w;
  });
  for (std::size_t n = core.y; n < core.bottom(); ++n) {
    double sums = 0, weights = 0;
    for (std::size_t i = n * patch.stride + core.x; i < n * patch.stride + core.right(); ++i) {
      const double w = weight(i);
      profile.energy += fast[i] * fast[i];
      sums += w * fast[i];
      weights += w * w;
    }
    if (weights > 0) profile.common += sums * sums / weights;
  }
  profile.uneven = uneven_variance(patch, core, fast, frequency);
  std::vector<double> of_columns(patch.stride);
  for_each(patch, core, [&](std::size_t i, std::size_t row) { of_columns[i - row * patch.stride] += weight(i); });
  for_each(patch, core,
           [&](std::size_t i, std::size_t row) { profile.even[row] += of_columns[i - row * patch.stride] * fast[i]; });
  profile.noise = static_cast<double>(core.pixels()) * noise_variance(patch, core);
  return profile;
}

// Σ Im²(z·φ*) / Σ |z|² of the swing z in the box; φ: phase of Σ z.
double across_phase(const Patch& patch, const ComplexValues& swing, const Region& core) {
  Complex sum = 0, squares = 0;
  double energy = 0;
  for_each(patch, core, [&](std::size_t i, std::size_t) {
    const Complex z = swing[i];
    sum += z, squares += product(z, z), energy += std::norm(z);
  });
  if (!(energy > 0) || sum == Complex(0)) return 0;
  const Complex phase = sum / std::abs(sum);
  return std::max(0.5 - 0.5 * product(squares, std::conj(product(phase, phase))).real() / energy, 0.0);
}

// Properties that distinguish a lamp from texture: its bars fill a bright contour, have one phase, and run along the
// rows. `seen`: frequency of the demodulation.
void add_appearance(const Patch& patch, const ComplexValues& swing, double seen, RefinedLight& light) {
  const double frequency = light.frequency;
  const auto mean = local_means(patch.light, patch.rows, patch.stride, hann_length(frequency));
  const Region core = patch.range(light.box);
  const std::size_t beside = std::max<std::size_t>(core.width / 2, 1), left = core.x - std::min(core.x, beside);
  const auto above = static_cast<std::size_t>(std::lround(1 / frequency));
  const std::size_t top = core.y - std::min(core.y, above);
  const Region wide{left, top, std::min(core.right() + beside, patch.groups) - left,
                    std::min(core.bottom() + above, patch.rows) - top};
  const auto sizes_in = [&](const Region& part) -> Eigen::ArrayXXd {
    return 2 * (patch.part_of(swing.real, part).square() + patch.part_of(swing.imaginary, part).square()).sqrt();
  };
  const Eigen::ArrayXXd swings = sizes_in(wide), means = patch.part_of(mean, wide), own = sizes_in(core);
  const Eigen::ArrayXXd away = swings - swings.mean(), off = means - means.mean();
  const double spread = away.square().sum() * off.square().sum();
  light.contour = spread > 0 ? (away * off).sum() / std::sqrt(spread) : 0;
  if (wide.width == core.width) light.contour = 1;  // it fills the frame
  const double bright = (own * patch.part_of(mean, core).max(0.0)).sum();
  light.depth = bright > 0 ? own.square().sum() / bright : 0;
  light.across = across_phase(patch, swing, core);
  measure_tilt(patch, swing, core, seen, light);
}

std::size_t harmonics_of(double frequency) { return std::min(static_cast<std::size_t>(0.499 / frequency), kMaxOrders); }

}  // namespace

double periodic_share(std::span<const double> matched, std::span<const double> weight, double frequency,
                      std::size_t most) {
  double total = 0, weights = 0;
  for (std::size_t n = 0; n < matched.size(); ++n) {
    if (!(weight[n] > 0)) continue;
    total += matched[n] * matched[n] / weight[n];
    weights += weight[n];
  }
  std::vector<Complex> sums(most);
  for (std::size_t n = 0; n < matched.size(); ++n) {
    if (matched[n] == 0) continue;
    const Complex turn = turned(frequency * static_cast<double>(n));
    Complex term = matched[n];
    for (std::size_t h = 0; h < most; ++h) sums[h] += term = product(term, turn);
  }
  double periodic = 0;
  for (const Complex& sum : sums) periodic += 2 * std::norm(sum) / weights;
  return total > 0 ? std::min(periodic / total, 1.0) : 0;
}

namespace {

// Probability of the periodic share that a signal has in its rows, from the first to the last that is not 0, in noise.
double chance_of(std::span<const double> signal, double frequency) {
  std::vector<double> weight(signal.size());
  std::ranges::transform(signal, weight.begin(), [](double x) { return x == 0 ? 0.0 : 1.0; });
  const double rows = std::accumulate(weight.begin(), weight.end(), 0.0);
  const std::size_t tones = harmonics_of(frequency);
  return chance_of_share(periodic_share(signal, weight, frequency, tones), tones,
                         rows - 1 - 2 * static_cast<double>(tones));
}

// The light in a box by its profile.
RefinedLight refined(const Patch& patch, const Profile& profile, const Region& box, double frequency, double error) {
  const double periodic = periodic_share(profile.matched, profile.weight, frequency, harmonics_of(frequency));
  RefinedLight light = light_of(profile, patch, box, frequency, error, common_share(profile) * periodic);
  light.periodic = periodic, light.chance = chance_of(profile.even, frequency), light.uneven = profile.uneven;
  return light;
}

}  // namespace

double common_share(const Profile& profile) {
  return profile.energy > 0 ? std::min(profile.common / profile.energy, 1.0) : 0;
}

RefinedLight light_of(const Profile& profile, const Patch& patch, const Region& box, double frequency, double error,
                      double explained) {
  const double rest = std::max(profile.energy * (1 - explained) - profile.noise, 0.0);
  return {.box = box,
          .frequency = frequency,
          .frequency_std = error,
          .phase = phase_at_start(profile.matched, frequency, patch.first_row),
          .snr = explained / std::max(1 - explained, 1e-12),
          .common = common_share(profile),
          .texture = rest / std::max(profile.energy * explained, 1e-300)};
}

void measure_tilt(const Patch& patch, const ComplexValues& swing, const Region& core, double seen,
                  RefinedLight& light) {
  const std::size_t groups = core.width;
  if (groups < kTiltGroups) return;
  std::vector<Complex> sums(groups);
  for (std::size_t n = core.y; n < core.bottom(); ++n) {
    const Complex turn = turned((light.frequency - seen) * static_cast<double>(n));
    for (std::size_t g = 0; g < groups; ++g) sums[g] += product(swing[n * patch.stride + core.x + g], turn);
  }
  Complex step = 0;
  for (std::size_t g = 1; g < groups; ++g) step += product(sums[g], std::conj(sums[g - 1]));
  const double slope = std::arg(step);
  Complex sum = 0;
  for (std::size_t g = 0; g < groups; ++g) sum += sums[g] *= std::polar(1.0, -slope * static_cast<double>(g));
  double weights = 0, middle = 0, moment = 0, force = 0, squares = 0;
  const auto visit = [&](auto of_group) {
    for (std::size_t g = 0; g < groups; ++g)
      of_group(static_cast<double>(g), product(sums[g], std::polar(1.0, -std::arg(sum))));
  };
  visit([&](double g, Complex z) { weights += std::max(z.real(), 0.0), middle += g * std::max(z.real(), 0.0); });
  if (!(weights > 0)) return;
  middle /= weights;
  visit([&](double g, Complex z) {
    const double away = g - middle;
    moment += away * away * std::max(z.real(), 0.0);
    force += away * z.imag(), squares += away * away * z.imag() * z.imag();
  });
  if (!(moment > 0)) return;
  const double spread = std::sqrt(squares * static_cast<double>(groups) / static_cast<double>(groups - 2)) / moment;
  const double per_column = 1 / (kTwoPi * light.frequency * static_cast<double>(patch.group));
  light.tilt = (slope + force / moment) * per_column, light.tilt_std = spread * per_column;
}

std::optional<RefinedLight> refine_source(const LitFrame& frame, const Suspect& suspect, double min_cycles, bool inside,
                                          int rounds) {
  const double edge = inside ? kMostly : kWholeBox;
  Region box = suspect.box;
  double frequency = suspect.frequency;
  bool doubles = false;
  for (int round = 1;; ++round) {
    const std::size_t margin = std::max(hann_length(frequency) + 2, doubles ? box.height : 0);
    const Patch patch = patch_of(frame, box, margin, margin);
    const auto window = hann_window(frequency, patch.rows, hann_length(frequency));
    const ComplexValues swing = swing_of(patch, patch.light, window);
    const auto lit = lit_box(patch, swing, box, round == 1 ? suspect.best : box, edge);
    if (!lit || 2 * lit->amplitude < 0.7 * frame.min_amplitude ||
        static_cast<double>(lit->box.height) < 0.7 * std::max(kMinRows, min_cycles / frequency))
      return {};
    const std::size_t known = box.height;
    box = lit->box;
    if (inside && static_cast<double>(box.height) * frequency > kLongestInner) return {};
    const Profile profile = inside ? Profile{} : profile_of(patch, window, box, frequency);
    const auto cycle = static_cast<std::size_t>(std::lround(1 / frequency));
    OwnPixels own = inside ? own_pixels(patch, swing, patch.range(box), 2 * cycle, edge * lit->amplitude) : OwnPixels{};
    const double reach = round == 1 ? kFirstReach : kFrequencyReach, last = frequency;
    const double lower = frequency * (1 - reach), upper = std::min(frequency * (1 + reach), 0.499);
    frequency = inside ? strongest_frequency(own, lower, upper) : strongest_frequency(profile.matched, lower, upper);
    if (frequency <= lower || frequency >= upper) return {};
    // A round sees two cycles above and below its box, less at a wrong frequency; of a long one that grows, all its
    // rows.
    const bool grows = static_cast<double>(box.height) > static_cast<double>(known) + 0.5 / frequency;
    doubles = grows && static_cast<double>(box.height) * frequency > kLongestInner;
    const bool settled = std::abs(frequency - last) <= kSettledFrequency * frequency && !grows;
    if (round < rounds || (!settled && round < kMaxIterations)) continue;
    box.width = std::min(box.width, shape_of(frame.frames).columns - box.x);
    RefinedLight light{};
    if (inside) {
      const auto fitted = fit_outline(own, frequency);
      if (!fitted) return {};
      light = refined_light(own, *fitted, noise_variance(patch, patch.range(box)));
      light.box = box, light.inside = true;
      add_appearance(patch, swing, last, light);
      const Region mine = own_box(own);
      light.box.y = mine.y, light.box.height = mine.height;
    } else {
      // Weights of each row are of its own noise, too, which passes for a tone of the frequency that they are from; an
      // even weight is not, but bent by the ends of few cycles.
      const double cycles = static_cast<double>(box.height) * frequency;
      const bool is_long = cycles > kLongestInner;
      const std::vector<double>& rows = is_long ? profile.even : profile.matched;
      if (is_long) frequency = strongest_frequency(rows, lower, upper);
      light = refined(patch, profile, box, frequency, jackknife_std(rows, frequency, cycles));
      light.systematic = systematic_error(profile.even, frequency, 1);  // windows of two cycles are cut at the ends
      add_appearance(patch, swing, last, light);
    }
    light.amplitude = 2 * lit->amplitude;
    return light;
  }
}

}  // namespace ocisac
