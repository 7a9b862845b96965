#include "cleaning/slow_tones.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "cleaning/slow_modes.hpp"
#include "core/check_interrupt.hpp"
#include "core/linear_algebra.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::Matrix4d;
using Eigen::MatrixXd;
using Eigen::Vector4d;
using Eigen::VectorXd;

constexpr double fall_of_modes = 1.5;  // of a picture's modes with their order; fitted to photographs
constexpr std::size_t spreads = 10;    // of a picture's factor S
constexpr double least_spread = 0.004, most_spread = 1;
constexpr std::array<double, 4> floors{0, 0.005, 0.01, 0.02};  // standard deviation that texture adds to every mode
constexpr double usual_spread = 0.1, log_spread = 1;           // median of S; standard deviation of its logarithm
constexpr std::size_t changes = 4;                             // of S of what changes from frame to frame
constexpr double least_change = 0.001, most_change = 0.2;
constexpr std::array<double, 4> trends{0.5, 0.5, 0.1, 0.05};  // standard deviations of a linear to quartic course:
                                                              // vignettes, skies
constexpr double usual_depth = 0.15;                          // expected size of a tone's cosine and sine
constexpr std::size_t phase_steps = 16;
constexpr std::array<double, 2> mains{100, 120};  // Hz
constexpr double real_row_time = 1e-3;            // s; a larger one is no camera's, but a unit
constexpr std::size_t places_of_mode = 8;
constexpr double turn = 2 * std::numbers::pi;
constexpr int near_tones = 9;
constexpr double near_cycles = 0.06;  // relative: those of neighbouring tones

// Logarithm of the sum of exponentials.
double log_sum(std::span<const double> values) {
  const double most = *std::max_element(values.begin(), values.end());
  double sum = 0;
  for (const double value : values) sum += std::exp(value - most);
  return most + std::log(sum);
}

// `count` values of equal ratio from `first` to `last`.
std::vector<double> ladder(double first, double last, std::size_t count) {
  std::vector<double> values;
  for (std::size_t k = 0; k < count; ++k)
    values.push_back(std::exp(std::log(first) + (std::log(last) - std::log(first)) * static_cast<double>(k) /
                                                    static_cast<double>(count - 1)));
  return values;
}

// A symmetric matrix of at most 4 × 4, and a vector.
struct Small {
  std::array<std::array<double, 4>, 4> values{};
  std::array<double, 4> right{};
};

// Solution of a positive definite system of `size` equations, the inverse of its matrix, and the logarithm of its
// determinant.
struct Solution {
  Small inverse;  // with the solution
  double log_size = 0;
};

Solution solved(const Small& system, std::size_t size) {
  std::array<std::array<double, 4>, 4> lower{};
  Solution result;
  for (std::size_t i = 0; i < size; ++i)
    for (std::size_t j = 0; j <= i; ++j) {
      double sum = system.values[i][j];
      for (std::size_t k = 0; k < j; ++k) sum -= lower[i][k] * lower[j][k];
      lower[i][j] = i == j ? std::sqrt(std::max(sum, 1e-300)) : sum / lower[j][j];
    }
  for (std::size_t i = 0; i < size; ++i) result.log_size += 2 * std::log(lower[i][i]);
  const auto solve = [&](std::array<double, 4> x) {
    for (std::size_t i = 0; i < size; ++i) {
      for (std::size_t k = 0; k < i; ++k) x[i] -= lower[i][k] * x[k];
      x[i] /= lower[i][i];
    }
    for (std::size_t i = size; i-- > 0;) {
      for (std::size_t k = i + 1; k < size; ++k) x[i] -= lower[k][i] * x[k];
      x[i] /= lower[i][i];
    }
    return x;
  };
  for (std::size_t j = 0; j < size; ++j) {
    std::array<double, 4> unit{};
    unit[j] = 1;
    result.inverse.values[j] = solve(unit);
  }
  result.inverse.right = solve(system.right);
  return result;
}

// A tone that is tried: cycles in the picture, phase step, probability before; index of its modes.
struct Tried {
  double cycles, step, prior;
  std::size_t modes;
};

struct Hypotheses {
  std::vector<Tried> tones;
  std::vector<MatrixXd> modes;  // (modes × 4) of each number of cycles
};

// (modes × 4) of the cosine and sine of a tone and of its second harmonic.
MatrixXd modes_of_tone(double cycles, std::size_t count) {
  const std::size_t places = places_of_mode * count;
  MatrixXd courses(static_cast<Index>(places), 4);
  for (Index n = 0; n < courses.rows(); ++n) {
    const double angle = turn * cycles * ((static_cast<double>(n) + 0.5) / static_cast<double>(places) - 0.5);
    courses(n, 0) = std::cos(angle);
    courses(n, 1) = std::sin(angle);
    courses(n, 2) = std::cos(2 * angle);
    courses(n, 3) = std::sin(2 * angle);
  }
  return transposed_product(slow_modes(places, count), courses) * (2 / static_cast<double>(places));
}

Hypotheses with_modes(std::vector<Tried> tones, std::size_t count) {
  Hypotheses result{std::move(tones), {}};
  std::vector<double> known;
  for (Tried& tone : result.tones) {
    const auto at = std::find(known.begin(), known.end(), tone.cycles);
    tone.modes = static_cast<std::size_t>(at - known.begin());
    if (at != known.end()) continue;
    known.push_back(tone.cycles);
    result.modes.push_back(modes_of_tone(tone.cycles, count));
  }
  return result;
}

std::vector<double> all_steps(std::size_t frames) {
  std::vector<double> steps;
  for (std::size_t k = 0; k < (frames > 1 ? phase_steps : 1); ++k)
    steps.push_back(turn * static_cast<double>(k) / static_cast<double>(phase_steps));
  return steps;
}

// Tones of every frequency and phase step; mains have half of the probability where the row time is known.
Hypotheses all_tones(std::size_t rows, const Camera& camera, std::size_t frames, std::size_t count) {
  const auto length = static_cast<double>(rows);
  const double most = std::min(std::max(1.1 * length / slowest_period, 2.5), most_cycles);
  const std::vector<double> steps = all_steps(frames);
  std::vector<Tried> tones;
  for (double cycles = least_cycles;; cycles += std::min(near_cycles * cycles, 0.25)) {
    for (const double step : steps) tones.push_back({cycles, step, 1, 0});
    if (!(cycles < most)) break;
  }
  for (Tried& tone : tones) tone.prior = 1 / static_cast<double>(tones.size());
  std::vector<double> seen;
  for (const double hertz : mains) {
    const double cycles = hertz * camera.row_time * length;
    if (camera.row_time < real_row_time && least_cycles < cycles && cycles < most) seen.push_back(hertz);
  }
  for (const double hertz : seen) {
    std::vector<double> known = steps;
    if (frames > 1 && camera.frame_time) known = {std::fmod(turn * hertz * *camera.frame_time, turn)};
    for (const double step : known)
      tones.push_back({hertz * camera.row_time * length, step, 1 / static_cast<double>(known.size() * seen.size()), 0});
  }
  double sum = 0;
  for (const Tried& tone : tones) sum += tone.prior;
  for (Tried& tone : tones) tone.prior /= sum;
  return with_modes(std::move(tones), count);
}

// Tones of nearly the same cycles and, where it is known, phase step.
Hypotheses tones_near(const SlowTone& tone, std::size_t frames, std::size_t count) {
  const auto place = [](int k) { return static_cast<double>(k) / (near_tones - 1) - 0.5; };
  std::vector<double> steps = all_steps(frames);
  if (frames > 1 && tone.step) {
    steps.clear();
    for (int k = 0; k < near_tones; ++k)
      steps.push_back(*tone.step + place(k) * turn / static_cast<double>(phase_steps));
  }
  const double each = 1 / static_cast<double>(near_tones * steps.size());
  std::vector<Tried> tones;
  for (int k = 0; k < near_tones; ++k)
    for (const double step : steps) tones.push_back({tone.cycles * (1 + near_cycles * place(k)), step, each, 0});
  return with_modes(std::move(tones), count);
}

// What the modes of the frames tell without a tone, and what they weigh with one, for every S and floor of the picture,
// and every S of what changes from frame to frame.
struct Evidence {
  std::vector<double> none;            // log evidence, by S and floor
  std::vector<MatrixXd> inverse;       // of the covariance of the mean modes
  std::vector<VectorXd> pull;          // that times the mean
  std::vector<double> none_of_change;  // log evidence, by S of the changes
  std::vector<VectorXd> weight;        // of the changes of the modes
  MatrixXd rest;                       // (modes × frames) less their mean
  std::vector<double> places;          // of the frames, after the first
};

// (modes × trends) modes of the slow courses of pictures, scaled by their standard deviations.
MatrixXd modes_of_trends(std::size_t count) {
  const std::size_t places = places_of_mode * count;
  MatrixXd courses(static_cast<Index>(places), static_cast<Index>(trends.size()));
  for (Index n = 0; n < courses.rows(); ++n)
    for (Index k = 0; k < courses.cols(); ++k) {
      const double place = 2 * (static_cast<double>(n) + 0.5) / static_cast<double>(places) - 1;
      courses(n, k) = trends[static_cast<std::size_t>(k)] * std::pow(place, static_cast<int>(k) + 1);
    }
  return transposed_product(slow_modes(places, count), courses) * (2 / static_cast<double>(places));
}

// Variance of the modes' changes from frame to frame that groups of columns have not in common.
VectorXd variance_of_changes(std::span<const CommonCourse> courses) {
  const std::size_t frames = courses.size(), modes = courses.front().modes.size();
  std::size_t groups = courses.front().groups.size();
  for (const CommonCourse& course : courses) groups = std::min(groups, course.groups.size());
  VectorXd result(static_cast<Index>(modes));
  for (std::size_t k = 0; k < modes; ++k) {
    MatrixXd values(static_cast<Index>(frames), static_cast<Index>(groups));
    for (Index frame = 0; frame < values.rows(); ++frame)
      for (Index group = 0; group < values.cols(); ++group)
        values(frame, group) = courses[static_cast<std::size_t>(frame)].groups[static_cast<std::size_t>(group)][k];
    const MatrixXd change = values.rowwise() - values.colwise().mean();
    const MatrixXd apart = change.colwise() - change.rowwise().mean();
    const double spread = apart.squaredNorm() / static_cast<double>(groups);
    result[static_cast<Index>(k)] =
        spread / static_cast<double>(std::max<std::size_t>(frames - 1, 1) * groups) + least_mode_variance;
  }
  return result;
}

// R of covariance = Rᵀ·R; log-determinant.
double log_determinant(const MatrixXd& covariance) {
  const MatrixXd factor = cholesky_factor(covariance, 0).value_or(MatrixXd::Identity(1, 1));
  return 2 * factor.diagonal().array().log().sum();
}

Evidence evidence_of(std::span<const CommonCourse> courses) {
  const auto count = static_cast<Index>(courses.front().modes.size()), frames = static_cast<Index>(courses.size());
  const auto number = static_cast<double>(frames);
  Evidence evidence;
  for (const CommonCourse& course : courses)
    evidence.places.push_back(static_cast<double>(course.place - courses.front().place));
  evidence.rest.resize(count, frames);
  VectorXd variance = VectorXd::Zero(count);
  for (Index frame = 0; frame < frames; ++frame)
    for (Index k = 0; k < count; ++k) {
      evidence.rest(k, frame) = courses[static_cast<std::size_t>(frame)].modes[static_cast<std::size_t>(k)];
      variance[k] += courses[static_cast<std::size_t>(frame)].variance[static_cast<std::size_t>(k)] / number;
    }
  const VectorXd mean = evidence.rest.rowwise().mean();
  evidence.rest.colwise() -= mean;
  VectorXd fall(count);
  for (Index k = 0; k < count; ++k) fall[k] = std::pow(static_cast<double>(k + 1), -2 * fall_of_modes);
  const MatrixXd trend = gram(modes_of_trends(static_cast<std::size_t>(count)));
  for (const double spread : ladder(least_spread, most_spread, spreads))
    for (const double floor : floors) {
      check_interrupt();
      MatrixXd covariance = trend;
      covariance.diagonal().array() += spread * spread * fall.array() + floor * floor + variance.array() / number;
      evidence.inverse.push_back(inverse(covariance));
      evidence.pull.emplace_back(evidence.inverse.back() * mean);
      const double away = std::log(spread / usual_spread) / log_spread;
      evidence.none.push_back(-0.5 * (away * away + log_determinant(covariance) + mean.dot(evidence.pull.back())));
    }
  const VectorXd of_rest = variance_of_changes(courses);
  for (const double change : ladder(least_change, most_change, frames > 1 ? changes : 0)) {
    evidence.weight.emplace_back((change * change * fall + of_rest).cwiseInverse());
    const VectorXd& weight = evidence.weight.back();
    const double squares = (evidence.rest.array().square().colwise() * weight.array()).sum();
    evidence.none_of_change.push_back(0.5 * ((number - 1) * weight.array().log().sum() - squares));
  }
  if (frames == 1) evidence.none_of_change.push_back(0);
  return evidence;
}

// Normal equations of the four terms of the tones of one number of cycles, for every entry of `Evidence`.
struct OfCycles {
  std::vector<Matrix4d> still, changing;
  std::vector<Vector4d> pull;   // of what stays
  std::vector<MatrixXd> pulls;  // (4 × frames), of what changes
};

OfCycles equations_of(const MatrixXd& modes, const Evidence& evidence) {
  OfCycles result;
  for (std::size_t k = 0; k < evidence.inverse.size(); ++k) {
    result.still.emplace_back(transposed_product(modes, product(evidence.inverse[k], modes)));
    result.pull.emplace_back(modes.transpose() * evidence.pull[k]);
  }
  for (const VectorXd& weight : evidence.weight) {
    const MatrixXd weighted = weight.asDiagonal() * modes;
    result.changing.emplace_back(transposed_product(modes, weighted));
    result.pulls.push_back(transposed_product(weighted, evidence.rest));
  }
  return result;
}

// Advance of the phases of both harmonics by `angle`.
Matrix4d rotation(double angle) {
  Matrix4d result = Matrix4d::Zero();
  for (Index harmonic = 0; harmonic < 2; ++harmonic) {
    const double turned = static_cast<double>(harmonic + 1) * angle;
    const Index at = 2 * harmonic;
    result(at, at) = result(at + 1, at + 1) = std::cos(turned);
    result(at, at + 1) = std::sin(turned);
    result(at + 1, at) = -std::sin(turned);
  }
  return result;
}

// Log evidence of one tone, and its solutions, for every S and floor and change (S and floor change slowest).
struct OfTone {
  std::vector<double> evidence;
  std::vector<Solution> solutions;
};

void add_to(const Matrix4d& matrix, const Vector4d& right, std::size_t size, Small& sum) {
  for (std::size_t i = 0; i < size; ++i) {
    sum.right[i] += right[static_cast<Index>(i)];
    for (std::size_t j = 0; j < size; ++j) sum.values[i][j] += matrix(static_cast<Index>(i), static_cast<Index>(j));
  }
}

OfTone compared(double step, const OfCycles& of_cycles, const Evidence& evidence, std::span<const double> sizes) {
  const std::size_t size = sizes.size();
  std::vector<Matrix4d> turns;
  Matrix4d still = Matrix4d::Zero();
  for (const double place : evidence.places) {
    turns.push_back(rotation(step * place));
    still += turns.back() / static_cast<double>(evidence.places.size());
  }
  std::vector<Small> of_changes(evidence.none_of_change.size());
  double log_sizes = 0;
  for (const double one : sizes) log_sizes += std::log(one);
  for (std::size_t change = 0; change < of_changes.size(); ++change) {
    for (std::size_t k = 0; k < size; ++k) of_changes[change].values[k][k] = 1 / (sizes[k] * sizes[k]);
    for (std::size_t frame = 0; frame < turns.size() && change < of_cycles.changing.size(); ++frame) {
      const Matrix4d moving = turns[frame] - still;
      add_to(moving.transpose() * of_cycles.changing[change] * moving,
             moving.transpose() * of_cycles.pulls[change].col(static_cast<Index>(frame)), size, of_changes[change]);
    }
  }
  OfTone result;
  for (std::size_t k = 0; k < evidence.none.size(); ++k) {
    const Matrix4d normal = still.transpose() * of_cycles.still[k] * still;
    const Vector4d right = still.transpose() * of_cycles.pull[k];
    for (std::size_t change = 0; change < of_changes.size(); ++change) {
      Small system = of_changes[change];
      add_to(normal, right, size, system);
      result.solutions.push_back(solved(system, size));
      const Solution& found = result.solutions.back();
      double gain = -found.log_size;
      for (std::size_t i = 0; i < size; ++i) gain += system.right[i] * found.inverse.right[i];
      result.evidence.push_back(evidence.none[k] + evidence.none_of_change[change] + 0.5 * gain - log_sizes);
    }
  }
  return result;
}

// Mean of the terms over all S, floors and changes, and the variance of each.
struct Posterior {
  std::array<double, 4> mean{}, variance{};
};

Posterior posterior_of(const OfTone& tone) {
  const double all = log_sum(tone.evidence);
  Posterior result;
  for (std::size_t k = 0; k < tone.evidence.size(); ++k)
    for (std::size_t i = 0; i < 4; ++i)
      result.mean[i] += std::exp(tone.evidence[k] - all) * tone.solutions[k].inverse.right[i];
  for (std::size_t k = 0; k < tone.evidence.size(); ++k)
    for (std::size_t i = 0; i < 4; ++i) {
      const double away = tone.solutions[k].inverse.right[i] - result.mean[i];
      result.variance[i] += std::exp(tone.evidence[k] - all) * (tone.solutions[k].inverse.values[i][i] + away * away);
    }
  return result;
}

// A tone that was tried, compared with none: likelihood and terms.
struct Compared {
  const Tried* tone;
  double likelihood;
  Posterior terms;
};

// Mean square by which the terms of tones that differ by their phase steps differ from those of the likeliest one, in
// the first or the last frame: two frames show the difference of two phasors, which has several solutions.
double ambiguity(std::span<const Compared> all, const Compared& best, double last) {
  double most = 0;
  for (const double frame : {0.0, last}) {
    const auto terms_of = [&](const Compared& one) {
      return Vector4d(rotation(one.tone->step * frame) * Eigen::Map<const Vector4d>(one.terms.mean.data()));
    };
    const Vector4d expected = terms_of(best);
    double sum = 0, weights = 0;
    for (const Compared& one : all) {
      if (one.tone->cycles != best.tone->cycles) continue;
      const double weight = std::exp(one.likelihood - best.likelihood);
      sum += weight * (terms_of(one) - expected).squaredNorm();
      weights += weight;
    }
    most = std::max(most, sum / weights);
  }
  return 0.5 * most;
}

// Compares the tones with none; the likeliest one, with the log odds of all together. The modes of the picture, of what
// changes from frame to frame, and the terms, whose standard deviations are `expected`, are Gaussian. The factors S,
// floors and changes are summed over.
SlowTone likeliest(std::span<const CommonCourse> courses, const Hypotheses& tried,
                   const std::vector<double>& expected) {
  const Evidence evidence = evidence_of(courses);
  std::vector<double> sizes;
  for (const double one : expected) sizes.insert(sizes.end(), 2, std::max(one, 1e-9));
  std::vector<OfCycles> of_cycles;
  for (const MatrixXd& modes : tried.modes) of_cycles.push_back(equations_of(modes, evidence));
  std::vector<Compared> all;
  std::vector<double> weighed, nothing;
  for (const Tried& tone : tried.tones) {
    check_interrupt();
    const OfTone found = compared(tone.step, of_cycles[tone.modes], evidence, sizes);
    all.push_back({&tone, log_sum(found.evidence), posterior_of(found)});
    weighed.push_back(all.back().likelihood + std::log(tone.prior));
  }
  for (const double still : evidence.none)
    for (const double change : evidence.none_of_change) nothing.push_back(still + change);
  const Compared& best = *std::max_element(
      all.begin(), all.end(), [](const Compared& a, const Compared& b) { return a.likelihood < b.likelihood; });
  const double doubt = ambiguity(all, best, evidence.places.back());
  return {best.tone->cycles,
          courses.size() > 1 ? std::optional(best.tone->step) : std::nullopt,
          best.terms.mean,
          {best.terms.variance[0] + doubt, best.terms.variance[1] + doubt},
          log_sum(weighed) - log_sum(nothing)};
}

bool is_mains(double cycles, std::size_t rows, double row_time) {
  for (const double hertz : mains) {
    const double expected = hertz * row_time * static_cast<double>(rows);
    if (std::abs(cycles - expected) <= 1e-8 + 1e-9 * expected) return true;
  }
  return false;
}

}  // namespace

SlowTone find_slow_tone(std::span<const CommonCourse> courses, std::size_t rows, const Camera& camera,
                        const std::optional<SlowTone>& near) {
  const std::size_t count = courses.front().modes.size(), frames = courses.size();
  const Hypotheses tried = near ? tones_near(*near, frames, count) : all_tones(rows, camera, frames, count);
  const SlowTone first = likeliest(courses, tried, {usual_depth});
  SlowTone best = first;
  const bool is_exact = near ? near->step || frames == 1 : is_mains(first.cycles, rows, camera.row_time);
  if (!is_exact) best = likeliest(courses, tones_near(first, frames, count), {usual_depth});
  best = refitted_tone(courses, best, {usual_depth, usual_harmonic * best.amplitude()});
  best.variance = first.variance;
  best.log_odds = first.log_odds;
  return best;
}

SlowTone refitted_tone(std::span<const CommonCourse> courses, const SlowTone& tone,
                       const std::vector<double>& expected) {
  const Hypotheses only = with_modes({{tone.cycles, tone.step.value_or(0), 1, 0}}, courses.front().modes.size());
  SlowTone found = likeliest(courses, only, expected);
  found.step = tone.step;
  found.log_odds = tone.log_odds;
  return found;
}

}  // namespace ocisac
