
#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>
#include <span>
#include <vector>

#include "core/levels.hpp"
#include "core/statistics.hpp"
#include "lights/light_patch.hpp"
#include "lights/profile_frequency.hpp"
#include "lights/refinement.hpp"
#include "ocisac/camera/linear_light.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/rows/tone_search.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

constexpr int kRounds = 2;
constexpr double kMinPower = 0.02;  // relative to the swing's near its maximum
constexpr std::size_t kMinEdges = 6, kMaxTimed = 64;
// Chips in a short interval; clock in cycles per row.
constexpr double kFastestChip = 2.2, kSlowestChip = 0.7, kLargestClock = 0.4;

// The run of true values about the middle one of those in [first, end).
std::optional<IndexRange> run_about(const std::vector<std::uint8_t>& places, std::size_t first, std::size_t end) {
  std::vector<std::size_t> inside;
  for (std::size_t i = first; i < end; ++i)
    if (places[i]) inside.push_back(i);
  if (inside.empty()) return {};
  std::size_t begin = inside[inside.size() / 2], last = begin;
  while (begin > 0 && places[begin - 1]) --begin;
  while (last + 1 < places.size() && places[last + 1]) ++last;
  return IndexRange{begin, last + 1};
}

// Fast test that the halves of the box swing alike; it rejects most suspects, which are noise.
bool halves_alike(const LitFrame& frame, const Region& box, std::size_t length) {
  if (box.width < 2) return false;
  const std::size_t middle = box.x + box.width / 2;
  const IndexRange rows{box.y, box.bottom()};
  return likeness(mean_swing(frame, {box.x, middle}, rows, length),
                  mean_swing(frame, {middle, box.right()}, rows, length)) > kTogether;
}

// Rows about the box in which the left and the right half of its columns correlate.
std::optional<Region> lit_rows(const LitFrame& frame, const Region& box, std::size_t length) {
  if (box.width < 2) return {};
  const std::size_t reach = std::max(8 * length, 2 * box.height), middle = box.x + box.width / 2;
  const std::size_t top = box.y - std::min(box.y, reach);
  const IndexRange rows{top, std::min(shape_of(frame.frames).rows, box.bottom() + reach)};
  const auto left = mean_swing(frame, {box.x, middle}, rows, length);
  const auto right = mean_swing(frame, {middle, box.right()}, rows, length);
  const auto power = [&](const std::vector<double>& a, const std::vector<double>& b) {
    std::vector<double> products(rows.size());
    std::ranges::transform(a, b, products.begin(), std::multiplies{});
    return local_means(products, length);
  };
  const auto both = power(left, right), own = power(left, left), other = power(right, right);
  const std::size_t first = box.y - top;
  std::vector<double> inside(both.begin() + static_cast<std::ptrdiff_t>(first),
                             both.begin() + static_cast<std::ptrdiff_t>(first + box.height));
  const auto high = inside.begin() + static_cast<std::ptrdiff_t>(inside.size() * 9 / 10);
  std::ranges::nth_element(inside, high);
  std::vector<std::uint8_t> lit(rows.size());
  for (std::size_t n = 0; n < lit.size(); ++n) {
    const double coherent = kTogether * std::sqrt(std::max(own[n] * other[n], 0.0));
    lit[n] = both[n] > std::max(coherent, kMinPower * *high);
  }
  const auto run = run_about(lit, first, first + box.height);
  if (!run) return {};
  return Region{box.x, top + run->begin, box.width, run->size()};
}

// Columns about the box that correlate with its own.
std::optional<Region> lit_columns(const LitFrame& frame, const Region& box, std::size_t length) {
  const Patch patch = patch_of(frame, box, std::max(box.width, box.height), 0);
  const auto fast = fast_logs(patch, length);
  const auto own = mean_swing(frame, {box.x, box.right()}, {box.y, box.bottom()}, length);
  const PatchArray swings = patch.array_of(fast);
  const Eigen::Map<const Eigen::ArrayXd> common(own.data(), std::ssize(own));
  const double energy = common.square().sum();
  const Eigen::ArrayXd squares = swings.square().colwise().sum(),
                       products = (swings.colwise() * common).colwise().sum();
  std::vector<std::uint8_t> lit(patch.groups);
  Eigen::Map<Eigen::Array<std::uint8_t, Eigen::Dynamic, 1>>(lit.data(), std::ssize(lit)) =
      (products > (kMostly * (squares * energy).sqrt()).max(kSmallShare * energy)).cast<std::uint8_t>();
  const std::size_t first = std::min((box.x - patch.first_column) / patch.group, patch.groups - 1);
  const std::size_t end = (box.right() - patch.first_column) / patch.group;
  const auto run = run_about(lit, first, std::clamp(end, first + 1, patch.groups));
  if (!run) return {};
  return Region{patch.first_column + run->begin * patch.group, box.y, run->size() * patch.group, box.height};
}

// Rows at which the waveform has crossed its mean.
std::vector<std::size_t> edges_of(std::span<const double> waveform) {
  const double lowest = kMostly * std::sqrt(product_at_lag(waveform, 0) / static_cast<double>(waveform.size()));
  std::vector<std::size_t> edges;
  int side = 0;
  for (std::size_t n = 0; n < waveform.size(); ++n) {
    const int now = waveform[n] > lowest ? 1 : waveform[n] < -lowest ? -1 : 0;
    if (now == 0 || now == side) continue;
    if (side != 0) edges.push_back(n);
    side = now;
  }
  return edges;
}

// Rayleigh's statistic |Σ e^{−j2πf·edge}|²/edges of the best clock f, minus the ln of the number of clocks tried; the
// second shortest interval is assumed to be one or two chips.
double clock_evidence(std::span<const std::size_t> edges) {
  edges = edges.first(std::min(edges.size(), kMaxTimed));
  std::vector<std::size_t> intervals;
  for (std::size_t i = 0; i + 1 < edges.size(); ++i) intervals.push_back(edges[i + 1] - edges[i]);
  std::ranges::sort(intervals);
  const double interval = std::max(static_cast<double>(intervals[1]), 2.0);
  const double slowest = kSlowestChip / interval, fastest = std::min(kFastestChip / interval, kLargestClock);
  const auto span = static_cast<double>(edges.back() - edges.front());
  const double step = 0.25 / span;
  const auto count = static_cast<std::size_t>(std::max(std::ceil((fastest - slowest) / step), 0.0));
  std::vector<std::complex<double>> sums(count);
  for (const std::size_t edge : edges) {
    const auto at = static_cast<double>(edge);
    const ComplexValues turns = turns_of(step * at, count);
    const auto start = turned(slowest * at);
    for (std::size_t i = 0; i < count; ++i) sums[i] += product(start, turns[i]);
  }
  double best = 0;
  for (const auto& sum : sums) best = std::max(best, std::norm(sum) / static_cast<double>(edges.size()));
  return std::max(best - std::log(std::max((fastest - slowest) * span, 1.0)), 0.0);
}

// Common waveform of the columns, Σ weight × log swing / √(Σ weight²).
Profile waveform_of(const Patch& patch, std::size_t length) {
  const std::vector<double> fast = fast_logs(patch, length);
  const Eigen::ArrayXd means = patch.array_of(fast).rowwise().mean();
  std::vector<double> weights = fast;
  for (std::size_t i = 0; i < weights.size(); ++i) weights[i] *= means(static_cast<Eigen::Index>(i / patch.stride));
  weights = local_means(weights, patch.rows, patch.stride, length);
  const Eigen::ArrayXXd weight = patch.array_of(weights).max(0.0);
  const Eigen::ArrayXd sizes = weight.square().rowwise().sum().sqrt();
  const Eigen::ArrayXd matched = (sizes > 0).select((weight * patch.array_of(fast)).rowwise().sum() / sizes, 0.0);
  Profile out;
  out.matched.assign(matched.begin(), matched.end());
  out.energy = patch.array_of(fast).square().sum(), out.common = matched.square().sum();
  out.noise = static_cast<double>(patch.rows * patch.groups) * noise_variance(patch, {0, 0, patch.groups, patch.rows});
  return out;
}

// Probability that rows that are white noise correlate with the next as much as those of the waveform; chips of several
// rows do.
double chance_of(std::span<const double> waveform) {
  const double power = product_at_lag(waveform, 0), product = product_at_lag(waveform, 1);
  if (!(product > 0)) return 1;
  return chance_of_share(product * product / (power * power), 1, static_cast<double>(waveform.size()) - 2);
}

// Frequency of the strongest tone of a waveform, if it leaves white noise.
std::optional<double> only_tone(std::vector<double> waveform) {
  const auto rows = static_cast<double>(waveform.size());
  const double about = strongest_tone(waveform, waveform.size(), 1 / rows, 0.5).frequency;
  const double frequency = strongest_frequency(waveform, std::max(about - 1 / rows, 0.0), about + 1 / rows);
  const std::complex<double> sum = component_at(waveform, frequency);
  for (std::size_t n = 0; n < waveform.size(); ++n)
    waveform[n] -= 2 / rows * product(std::conj(sum), turned(frequency * static_cast<double>(n))).real();
  return is_white(waveform) ? std::optional(frequency) : std::nullopt;
}

// Largest share of a waveform that is periodic: its strongest tone is the first or the second harmonic, as of rows of
// pins or dots.
double largest_periodic_share(std::span<const double> waveform, double frequency) {
  const std::vector<double> even(waveform.size(), 1);
  return std::max(periodic_share(waveform, even, frequency, kComparedHarmonics),
                  periodic_share(waveform, even, frequency / 2, kComparedHarmonics));
}

// Amplitude: RMS of the mean light over the columns, local mean removed.
void add_swing(const Patch& patch, std::size_t length, RefinedLight& light) {
  const Eigen::ArrayXd means = patch.array_of(patch.light).rowwise().mean();
  std::vector<double> rows(means.begin(), means.end());
  const double mean = mean_of(rows);
  const auto slow = local_means(rows, length);
  std::ranges::transform(rows, slow, rows.begin(), std::minus{});
  light.amplitude = std::sqrt(product_at_lag(rows, 0) / static_cast<double>(patch.rows));
  light.depth = mean > 0 ? light.amplitude / mean : 1;
}

}  // namespace

std::optional<RefinedLight> find_data_light(const LitFrame& frame, const Suspect& suspect) {
  const Shape shape = shape_of(frame.frames);
  const std::size_t length = hann_length(0.5 * suspect.frequency);
  Region box = suspect.box;
  box.width = std::min(box.width, shape.columns - box.x);
  box.height = std::min(box.height, shape.rows - box.y);
  if (!halves_alike(frame, box, length)) return {};
  for (int round = 0; round < kRounds; ++round) {
    const auto rows = lit_rows(frame, box, length);
    const auto columns = rows ? lit_columns(frame, *rows, length) : std::nullopt;
    if (!columns) return {};
    box = *columns;
  }
  const Patch patch = patch_of(frame, box, 0, 0);
  if (patch.groups < 2) return {};
  const Profile waveform = waveform_of(patch, length);
  const auto edges = edges_of(waveform.matched);
  if (edges.size() < kMinEdges || !(waveform.energy > 0)) return {};
  const auto tone = only_tone(waveform.matched);
  double frequency = tone.value_or(suspect.frequency), error = 0;
  for (int round = 0; round < kMaxIterations && error == 0; ++round) {
    const double lower = frequency * (1 - kFirstReach), upper = std::min(frequency * (1 + kFirstReach), 0.499);
    if (!tone) frequency = strongest_frequency(waveform.matched, lower, upper);
    if (lower < frequency && frequency < upper)
      error = jackknife_std(waveform.matched, frequency, static_cast<double>(box.height) * frequency);
    else if (round + 1 == kMaxIterations)
      error = 0.5 * (upper - lower);
  }
  RefinedLight light = light_of(waveform, patch, box, frequency, error, common_share(waveform));
  light.periodic = largest_periodic_share(waveform.matched, frequency);
  light.chance = chance_of(waveform.matched);
  light.only_tone = tone.has_value();
  light.edges = edges.size(), light.clock = clock_evidence(edges);
  add_swing(patch, length, light);
  const ComplexValues swing = swing_of(patch, patch.logs, hann_window(frequency, patch.rows, hann_length(frequency)));
  measure_tilt(patch, swing, {0, 0, patch.groups, patch.rows}, frequency, light);
  return light;
}

}  // namespace ocisac
