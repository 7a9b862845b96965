#include "ocisac/receiver/source_refinement.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <span>
#include <vector>

#include "ocisac/camera/linear_light.hpp"

namespace ocisac {

namespace {

using Complex = std::complex<double>;

constexpr std::size_t most_groups = 64;    // of columns in a patch
constexpr std::size_t most_columns = 512;  // converted to light at a time
constexpr double box_edge = 0.15;          // of the largest amplitude
constexpr double least_alignment = 0.5;    // cosine of the angle to the light's phase
constexpr double frequency_reach = 0.12;   // relative, in a round
constexpr int rounds = 2;
constexpr std::size_t harmonics = 3;
constexpr std::size_t most_jackknife = 16;

struct Box {
  std::size_t column, row, width, height;
};

// e^{−j2πx}
Complex turned(double cycles) {
  const double angle = -2 * std::numbers::pi * (cycles - std::floor(cycles));
  return {std::cos(angle), std::sin(angle)};
}

// Without the detour that infinities take in the standard's.
Complex product(Complex a, Complex b) {
  return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

// Without the care of the standard's for what is close to the ends of the exponents.
double size(Complex z) { return std::sqrt(std::norm(z)); }

// Groups of columns of a part of the frame: (groups × rows), linear light and its logarithm.
struct Patch {
  std::size_t first_column, first_row, rows, groups, group;
  std::vector<double> light, logs;

  [[nodiscard]] std::span<const double> signal(const std::vector<double>& of, std::size_t g) const {
    return {&of[g * rows], rows};
  }
};

Patch patch_of(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve, const Box& box,
               std::size_t margin, double floor) {
  const Shape shape = shape_of(frames);
  const std::size_t left = box.column - std::min(box.column, margin);
  const std::size_t right = std::min(shape.columns, box.column + box.width + margin);
  const std::size_t top = box.row - std::min(box.row, margin);
  const std::size_t bottom = std::min(shape.rows, box.row + box.height + margin);
  // As many columns a group as keep their number bounded, and small lights sharp.
  const std::size_t group = std::max<std::size_t>((right - left + most_groups - 1) / most_groups,
                                                  std::clamp<std::size_t>(box.width / 16, 1, 8));
  Patch patch{left, top, bottom - top, std::max<std::size_t>((right - left) / group, 1), group, {}, {}};
  const AnyFramesView part = std::visit(
      [&](auto view) -> AnyFramesView {
        view.data = view.at(frame, top, left);
        view.frames = 1;
        view.rows = bottom - top;
        view.columns = right - left;
        return view;
      },
      frames);
  patch.light.resize(patch.groups * patch.rows);
  const std::size_t members = std::min(group, right - left), strip = std::max<std::size_t>(most_columns / members, 1);
  for (std::size_t first = 0; first < patch.groups; first += strip) {
    const std::size_t count = std::min(strip, patch.groups - first) * members;
    const auto signals = column_signals(part, 0, first * members, count, curve);
    for (std::size_t c = 0; c < count; ++c)
      for (std::size_t n = 0; n < patch.rows; ++n)
        patch.light[(first + c / members) * patch.rows + n] +=
            signals[c * patch.rows + n] / static_cast<double>(members);
  }
  for (const double v : patch.light) patch.logs.push_back(std::log(std::max(v, 0.0) + floor));
  return patch;
}

// e^{−j2πfm} for the rows from `reach` before the first to `reach` after the last of `rows`.
std::vector<Complex> phasors(double frequency, std::size_t rows, std::size_t reach) {
  std::vector<Complex> out(rows + 2 * reach);
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = turned(frequency * (static_cast<double>(i) - static_cast<double>(reach)));
  return out;
}

// A Hann window of `length` rows (odd) and sum 1 as three running sums:
// z(n) = Σ_m k(m − n)·x(m)·e^{−j2πfm}; rows before and after repeat the first and the last.
class HannDemodulator {
 public:
  HannDemodulator(double frequency, std::size_t length, std::size_t rows)
      : length_(length), reach_(length / 2), bin_(1 / static_cast<double>(length)), sums_(rows + 2 * reach_ + 1) {
    for (std::size_t k = 0; k < 3; ++k)
      carriers_[k] = phasors(frequency + (static_cast<double>(k) - 1) * bin_, rows, reach_);
    turns_ = phasors(bin_, rows, 0);
  }

  // Adds to `z` (rows).
  void operator()(std::span<const double> x, std::span<Complex> z) {
    for (std::size_t k = 0; k < 3; ++k) {
      for (std::size_t i = 0; i + 1 < sums_.size(); ++i)
        sums_[i + 1] = sums_[i] + x[std::min(i - std::min(i, reach_), x.size() - 1)] * carriers_[k][i];
      for (std::size_t n = 0; n < x.size(); ++n) {
        const Complex part = sums_[n + length_] - sums_[n];
        const Complex turn = k == 1 ? Complex(2) : k == 0 ? turns_[n] : std::conj(turns_[n]);
        z[n] += 0.5 * bin_ * product(turn, part);
      }
    }
  }

 private:
  std::size_t length_, reach_;
  double bin_;
  std::array<std::vector<Complex>, 3> carriers_;
  std::vector<Complex> turns_, sums_;
};

std::size_t hann_length(double frequency) { return static_cast<std::size_t>(std::lround(1 / frequency)) * 2 + 1; }

std::vector<Complex> demodulated(const Patch& patch, const std::vector<double>& of, double frequency) {
  std::vector<Complex> map(of.size());
  HannDemodulator demodulate(frequency, hann_length(frequency), patch.rows);
  std::vector<double> centred(patch.rows);
  for (std::size_t g = 0; g < patch.groups; ++g) {
    const auto x = patch.signal(of, g);
    double mean = 0;
    for (const double v : x) mean += v / static_cast<double>(patch.rows);
    std::ranges::transform(x, centred.begin(), [&](double v) { return v - mean; });
    demodulate(centred, std::span(map).subspan(g * patch.rows, patch.rows));
  }
  return map;
}

Box widened(const Box& box, std::size_t by) {
  const std::size_t left = std::min(box.column, by), up = std::min(box.row, by);
  return {box.column - left, box.row - up, box.width + left + by, box.height + up + by};
}

// An element of a patch: its index, and its row, which a division would have to find.
struct Element {
  std::size_t at, row;
};

// The patch's elements that lie inside the box.
std::vector<Element> inside(const Patch& patch, const Box& box) {
  std::vector<Element> elements;
  for (std::size_t g = 0; g < patch.groups; ++g) {
    const std::size_t left = patch.first_column + g * patch.group;
    if (left + patch.group <= box.column || left >= box.column + box.width) continue;
    const std::size_t begin = std::max(box.row, patch.first_row) - patch.first_row;
    const std::size_t end =
        std::min(patch.rows, box.row + box.height - std::min(box.row + box.height, patch.first_row));
    for (std::size_t n = begin; n < end; ++n) elements.push_back({g * patch.rows + n, n});
  }
  return elements;
}

struct Lit {
  Box box;
  Complex phase;     // of unit length
  double amplitude;  // near the largest, of |z|
};

// The light's box: the connected part with the most swing that begins in the suspect's.
std::optional<Lit> lit_box(const Patch& patch, const std::vector<Complex>& swing, const Box& suspect) {
  const auto where = inside(patch, suspect);
  if (where.empty()) return {};
  Complex sum = 0;
  std::vector<double> sizes;
  for (const auto& [i, row] : where) {
    sum += size(swing[i]) * swing[i];
    sizes.push_back(size(swing[i]));
  }
  const auto high = sizes.begin() + static_cast<std::ptrdiff_t>((sizes.size() - 1) * 98 / 100);
  std::ranges::nth_element(sizes, high);
  const double largest = *high;
  if (!(largest > 0) || sum == Complex(0)) return {};
  const Complex phase = sum / std::abs(sum);
  const auto aligned = [&](std::size_t i) { return (swing[i] * std::conj(phase)).real(); };
  std::vector<std::uint8_t> open_to(swing.size());
  for (std::size_t i = 0; i < swing.size(); ++i)
    open_to[i] = aligned(i) > std::max(least_alignment * size(swing[i]), box_edge * largest);
  double best = 0;
  Box box{};
  std::vector<std::size_t> stack;
  for (const auto& [start, row] : where) {
    if (!open_to[start]) continue;
    std::size_t left = patch.groups, right = 0, top = patch.rows, bottom = 0;
    double weight = 0;
    stack.assign(1, start);
    open_to[start] = 0;
    while (!stack.empty()) {
      const std::size_t at = stack.back(), g = at / patch.rows, n = at % patch.rows;
      stack.pop_back();
      weight += aligned(at);
      left = std::min(left, g), right = std::max(right, g), top = std::min(top, n), bottom = std::max(bottom, n);
      for (std::size_t h = g - (g > 0); h <= std::min(g + 1, patch.groups - 1); ++h)
        for (std::size_t m = n - (n > 0); m <= std::min(n + 1, patch.rows - 1); ++m)
          if (open_to[h * patch.rows + m]) {
            open_to[h * patch.rows + m] = 0;
            stack.push_back(h * patch.rows + m);
          }
    }
    if (weight <= best) continue;
    best = weight;
    box = {patch.first_column + left * patch.group, patch.first_row + top, (right - left + 1) * patch.group,
           bottom - top + 1};
  }
  if (best == 0) return {};
  return Lit{box, phase, largest};
}

// Log light less its mean over two cycles (Hann), which holds nothing of the tone.
std::vector<double> without_trend(const Patch& patch, double frequency) {
  std::vector<double> out = patch.logs;
  HannDemodulator smooth(0, hann_length(frequency), patch.rows);
  std::vector<Complex> slow(patch.rows);
  for (std::size_t g = 0; g < patch.groups; ++g) {
    std::ranges::fill(slow, Complex(0));
    smooth(patch.signal(patch.logs, g), slow);
    for (std::size_t n = 0; n < patch.rows; ++n) out[g * patch.rows + n] -= slow[n].real();
  }
  return out;
}

// J(f) = Σ_h |Σ_n x(n)·e^{−j2πhfn}|², with its first two derivatives.
struct Energy {
  double value = 0, slope = 0, curvature = 0;
};

Energy harmonic_energy(std::span<const double> x, double frequency) {
  std::array<Complex, harmonics> p{}, p1{}, p2{};
  const auto most = std::min<std::size_t>(harmonics, static_cast<std::size_t>(std::ceil(0.5 / frequency)) - 1);
  for (std::size_t n = 0; n < x.size(); ++n) {
    if (x[n] == 0) continue;
    const double at = static_cast<double>(n) - 0.5 * static_cast<double>(x.size());
    const Complex turn = turned(frequency * at);
    Complex term = x[n] * turn;
    for (std::size_t h = 0; h < most; ++h) {
      const double rate = 2 * std::numbers::pi * static_cast<double>(h + 1) * at;
      p[h] += term;
      p1[h] += Complex(rate * term.imag(), -rate * term.real());
      p2[h] -= rate * rate * term;
      term = product(term, turn);
    }
  }
  Energy sum;
  for (std::size_t h = 0; h < most; ++h) {
    sum.value += std::norm(p[h]);
    sum.slope += 2 * (std::conj(p[h]) * p1[h]).real();
    sum.curvature += 2 * (std::norm(p1[h]) + (std::conj(p[h]) * p2[h]).real());
  }
  return sum;
}

// The maximum near `frequency`: Newton's steps, none longer than a quarter of a cycle over the profile, and uphill
// where there is no summit yet.
double climbed(std::span<const double> x, double frequency, double lower, double upper) {
  const double longest = 0.25 / static_cast<double>(x.size());
  for (int step = 0; step < 40; ++step) {
    const Energy energy = harmonic_energy(x, frequency);
    const double newton =
        energy.curvature < 0 ? -energy.slope / energy.curvature : std::copysign(longest, energy.slope);
    const double next = std::clamp(frequency + std::clamp(newton, -longest, longest), lower, upper);
    const bool settled = std::abs(next - frequency) < 1e-10;
    frequency = next;
    if (settled) break;
  }
  return frequency;
}

// The peak of the fundamental on a grid of an eighth of a cycle over the profile, then that of all harmonics near it.
double strongest_frequency(std::span<const double> x, double lower, double upper) {
  const double step = 0.125 / static_cast<double>(x.size());
  const auto count = static_cast<std::size_t>((upper - lower) / step) + 1;
  double best = lower, most = -1;
  for (std::size_t i = 0; i <= count; ++i) {
    const double frequency = std::min(lower + static_cast<double>(i) * step, upper);
    const Complex turn = turned(frequency);
    Complex sum = 0;
    for (std::size_t n = x.size(); n-- > 0;) sum = product(sum, turn) + x[n];  // Horner
    if (std::norm(sum) > most) most = std::norm(sum), best = frequency;
  }
  return climbed(x, best, lower, upper);
}

// Delete-a-group jackknife (Efron and Stein 1981), each group whole cycles of `x`.
double jackknife_std(std::span<const double> x, double frequency, double cycles, double lower, double upper) {
  const auto groups = std::clamp<std::size_t>(static_cast<std::size_t>(cycles), 2, most_jackknife);
  std::size_t first = 0, last = x.size();
  while (first < last && x[first] == 0) ++first;
  while (last > first && x[last - 1] == 0) --last;
  std::vector<double> rest(x.begin(), x.end()), found;
  for (std::size_t k = 0; k < groups; ++k) {
    const std::size_t begin = first + k * (last - first) / groups, end = first + (k + 1) * (last - first) / groups;
    std::fill(rest.begin() + static_cast<std::ptrdiff_t>(begin), rest.begin() + static_cast<std::ptrdiff_t>(end), 0.0);
    found.push_back(climbed(rest, frequency, lower, upper));
    std::copy(x.begin() + static_cast<std::ptrdiff_t>(begin), x.begin() + static_cast<std::ptrdiff_t>(end),
              rest.begin() + static_cast<std::ptrdiff_t>(begin));
  }
  double mean = 0, square = 0;
  for (const double f : found) mean += f / static_cast<double>(groups);
  for (const double f : found) square += (f - mean) * (f - mean);
  return std::sqrt(square * static_cast<double>(groups - 1) / static_cast<double>(groups));
}

struct Profile {
  std::vector<double> matched;  // (patch rows): Σ over the light's columns of weight × log swing; 0 outside
  std::vector<double> weight;   // Σ of squared weights
  double energy = 0;            // Σ of squared log swing, in the box
  double common = 0;            // that of the weighted mean over the columns
  double noise = 0;             // Σ of the variance of noise, in the box
  double uneven = 0;            // depth at the frequency of the rows' variance across the columns, in the box, 0 to 1
};

// Light multiplies a picture, which leaves its texture in log light the same in bright rows and dark ones. Lines of
// text have theirs in the rows of the letters.
double uneven_variance(const Patch& patch, std::span<const Element> elements, const std::vector<double>& fast,
                       double frequency) {
  std::vector<double> sum(patch.rows), square(patch.rows), count(patch.rows);
  for (const auto& [i, row] : elements) {
    sum[row] += fast[i];
    square[row] += fast[i] * fast[i];
    count[row] += 1;
  }
  Complex tone = 0;
  double total = 0;
  for (std::size_t n = 0; n < patch.rows; ++n) {
    if (count[n] == 0) continue;
    const double variance = std::max(square[n] - sum[n] * sum[n] / count[n], 0.0);
    tone += variance * turned(frequency * static_cast<double>(n));
    total += variance;
  }
  return total > 0 ? std::abs(tone) / total : 0;
}

// Of an element of log light, from the median of mixed differences over neighbouring rows and groups: edges and strokes
// are few enough not to count.
double noise_variance(const Patch& patch, std::span<const Element> elements) {
  std::vector<double> differences;
  for (const auto& [i, row] : elements) {
    if (row + 1 >= patch.rows || i + patch.rows >= patch.logs.size()) continue;
    const double* at = &patch.logs[i];
    differences.push_back(std::abs(at[0] - at[1] - at[patch.rows] + at[patch.rows + 1]));
  }
  if (differences.empty()) return 0;
  const auto middle = differences.begin() + static_cast<std::ptrdiff_t>(differences.size() / 2);
  std::ranges::nth_element(differences, middle);
  constexpr double median_of_normal = 0.6745;
  return *middle * *middle / (4 * median_of_normal * median_of_normal);
}

// Weighted with the local swing in log light, in the box and two cycles more on each side.
Profile profile_of(const Patch& patch, const Lit& lit, double frequency) {
  const auto swing = demodulated(patch, patch.logs, frequency);
  const auto fast = without_trend(patch, frequency);
  const auto cycle = static_cast<std::size_t>(std::lround(1 / frequency));
  const Box wide = widened(lit.box, 2 * cycle);
  Complex sum = 0;
  const auto core = inside(patch, lit.box);
  for (const auto& [i, row] : core) sum += swing[i];
  const Complex phase = sum == Complex(0) ? Complex(1) : sum / std::abs(sum);
  Profile profile{std::vector<double>(patch.rows), std::vector<double>(patch.rows), 0, 0};
  const auto weight = [&](std::size_t i) { return std::max((swing[i] * std::conj(phase)).real(), 0.0); };
  for (const auto& [i, row] : inside(patch, wide)) {
    profile.matched[row] += weight(i) * fast[i];
    profile.weight[row] += weight(i) * weight(i);
  }
  std::vector<double> sums(patch.rows), weights(patch.rows);
  for (const auto& [i, row] : core) {
    profile.energy += fast[i] * fast[i];
    sums[row] += weight(i) * fast[i];
    weights[row] += weight(i) * weight(i);
  }
  for (std::size_t n = 0; n < patch.rows; ++n)
    if (weights[n] > 0) profile.common += sums[n] * sums[n] / weights[n];
  profile.uneven = uneven_variance(patch, core, fast, frequency);
  profile.noise = static_cast<double>(core.size()) * noise_variance(patch, core);
  return profile;
}

// Least squares of weight·(harmonics) to the profile by projection: share of its energy that is periodic.
double periodic_share(const Profile& profile, double frequency) {
  double total = 0, weights = 0;
  std::vector<double> shape(profile.matched.size());
  for (std::size_t n = 0; n < shape.size(); ++n) {
    if (!(profile.weight[n] > 0)) continue;
    total += profile.matched[n] * profile.matched[n] / profile.weight[n];
    weights += profile.weight[n];
  }
  double periodic = 0;
  const auto most = static_cast<std::size_t>(0.499 / frequency);
  for (std::size_t h = 1; h <= std::min<std::size_t>(most, 9); ++h) {
    Complex p = 0;
    for (std::size_t n = 0; n < shape.size(); ++n)
      p += profile.matched[n] * turned(static_cast<double>(h) * frequency * static_cast<double>(n));
    periodic += 2 * std::norm(p) / weights;
  }
  return total > 0 ? std::min(periodic / total, 1.0) : 0;
}

}  // namespace

std::optional<RefinedLight> refine_source(const AnyFramesView& frames, std::size_t frame, const ToneCurve& curve,
                                          const Suspect& suspect, double floor, const LightLimits& limits) {
  Box box{suspect.column, suspect.row, suspect.width, suspect.height};
  double frequency = suspect.frequency;
  std::optional<RefinedLight> result;
  for (int round = 0; round < rounds; ++round) {
    const std::size_t margin = hann_length(frequency) + 2;
    const Patch patch = patch_of(frames, frame, curve, box, margin, floor);
    const auto swing = demodulated(patch, patch.light, frequency);
    const auto lit = lit_box(patch, swing, box);
    if (!lit || 2 * lit->amplitude < 0.7 * limits.amplitude ||
        static_cast<double>(lit->box.height) < 0.7 * std::max(limits.rows, limits.cycles / frequency))
      return {};
    const Profile profile = profile_of(patch, *lit, frequency);
    const double lower = frequency * (1 - frequency_reach), upper = std::min(frequency * (1 + frequency_reach), 0.499);
    frequency = strongest_frequency(profile.matched, lower, upper);
    if (frequency <= lower || frequency >= upper) return {};
    box = lit->box;
    if (round + 1 < rounds) continue;
    const double cycles = static_cast<double>(box.height) * frequency;
    const double common = profile.energy > 0 ? std::min(profile.common / profile.energy, 1.0) : 0;
    const double periodic = periodic_share(profile, frequency);
    const double explained = common * periodic;
    const Shape shape = shape_of(frames);
    box.width = std::min(box.width, shape.columns - box.column);
    Complex at_start = 0;
    for (std::size_t n = 0; n < patch.rows; ++n)
      at_start += profile.matched[n] * turned(frequency * static_cast<double>(patch.first_row + n));
    result = RefinedLight{
        box.column,
        box.row,
        box.width,
        box.height,
        frequency,
        jackknife_std(profile.matched, frequency, cycles, lower, upper),
        std::arg(at_start),
        explained / std::max(1 - explained, 1e-12),
        2 * lit->amplitude,
        common,
        periodic,
        std::max(profile.energy * (1 - explained) - profile.noise, 0.0) / std::max(profile.energy * explained, 1e-300),
        profile.uneven};
  }
  return result;
}

}  // namespace ocisac
