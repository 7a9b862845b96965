#include "cleaning/slow_tones.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "cleaning/cleaned_picture.hpp"
#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
#include "core/linear_algebra.hpp"
#include "ocisac/cleaning/column_bundles.hpp"

namespace ocisac {

namespace {

using Eigen::Index;
using Eigen::Matrix2d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector4d;
using Eigen::VectorXd;

// A picture's modes fall with their order by these powers: fitted to photographs; shades of walls and skies, tried in
// single frames.
constexpr double kFallOfModes = 1.5, kFallOfShades = 3;
constexpr std::size_t kSpreads = 10;  // of a picture's factor S
constexpr double kLeastSpread = 0.004, kMostSpread = 1;
constexpr std::array<double, 4> kFloors{0, 0.01, 0.03, 0.1};  // standard deviation that texture adds to every mode
constexpr double kUsualSpread = 0.1;  // median of S, whose logarithm has a standard deviation of 1
constexpr std::size_t kChanges = 4;   // of S of what changes from frame to frame
constexpr double kLeastChange = 0.001, kMostChange = 0.2;
constexpr std::array<double, 4> kTrends{0.5, 0.5, 0.1, 0.05};  // standard deviations of a linear to quartic course:
                                                               // vignettes, skies
constexpr double kNearBlack = 0.03;                            // of the mean light, to which it fades
constexpr double kFade = 0.15;                                 // standard deviation of the exponent of a fade
constexpr std::array<double, 3> kSizes{0.05, 0.15, 0.5};       // expected of a tone's terms, one as likely as another
constexpr std::size_t kPhaseSteps = 16;
constexpr std::size_t kPlacesOfMode = 8;
constexpr double kNearCycles = 0.06;  // between neighbouring tones, relative
constexpr std::size_t kMostTones = 3;
constexpr std::size_t kParameters = 4;  // of a tone: its two terms, cycles and phase step
constexpr double kStays = 1e-9;         // deviation of a parameter that is not fitted

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
    values.push_back(first * std::pow(last / first, static_cast<double>(k) / static_cast<double>(count - 1)));
  return values;
}

// Modes (modes × columns) of courses at places of a picture; `slow`: (places × modes).
MatrixXd modes_of_courses(const MatrixXd& slow, const MatrixXd& courses) {
  return transposed_product(slow, courses) * (2 / static_cast<double>(slow.rows()));
}

double from_middle(Index place, Index places) {
  return (static_cast<double>(place) + 0.5) / static_cast<double>(places) - 0.5;
}

// (modes × trends) modes of the slow courses of pictures, scaled by their standard deviations: polynomials of the
// logarithm, and light that falls evenly to near black, upwards or downwards.
MatrixXd modes_of_trends(const MatrixXd& slow) {
  constexpr std::size_t kPolynomials = kTrends.size();
  MatrixXd courses(slow.rows(), static_cast<Index>(kPolynomials + 2));
  for (Index n = 0; n < courses.rows(); ++n) {
    const double place = 2 * from_middle(n, slow.rows());
    for (std::size_t k = 0; k < kPolynomials; ++k)
      courses(n, static_cast<Index>(k)) = kTrends[k] * std::pow(place, static_cast<int>(k) + 1);
    courses(n, kPolynomials) = kFade * std::log(1 + kNearBlack + place);
    courses(n, kPolynomials + 1) = kFade * std::log(1 + kNearBlack - place);
  }
  return modes_of_courses(slow, courses);
}

// Covariance of the mean modes of a picture for one S and floor: its inverse is diag(weight) − trend·trendᵀ.
struct Spread {
  VectorXd weight;
  MatrixXd trend;
  double log_scale;  // of its density: prior of S, less half the logarithm of its determinant

  [[nodiscard]] MatrixXd times(const MatrixXd& x) const {
    return weight.asDiagonal() * x - product(trend, transposed_product(trend, x));
  }
};

Spread spread_of(const VectorXd& variance, const MatrixXd& trend, double log_prior) {
  const VectorXd weight = variance.cwiseInverse();
  const MatrixXd scaled = weight.asDiagonal() * trend;
  MatrixXd small = transposed_product(trend, scaled);
  small.diagonal().array() += 1;
  const MatrixXd factor = cholesky_factor(small, 0).value_or(small);
  const double log_determinant = variance.array().log().sum() + 2 * factor.diagonal().array().log().sum();
  return {weight, solve_upper_transposed(factor, scaled.transpose()).transpose(), log_prior - 0.5 * log_determinant};
}

// Prior of the modes of some frames without a tone: a picture that stays, for every S and floor, and changes from
// frame to frame, for every S of these.
struct Frames {
  MatrixXd modes;                  // (modes × frames)
  MatrixXd slow;                   // (places × modes) cosines
  std::vector<double> places;      // of the frames, after the first
  std::vector<Spread> still;       // of their mean
  std::vector<VectorXd> changing;  // inverse variances of the deviations from it; none for one frame
};

// Variance of the mean of groups over that of independent ones, by the correlation r of neighbours: (1 + r)/(1 − r).
// Shades are wider than a group.
double of_dependence(const std::vector<std::vector<double>>& groups) {
  const auto count = static_cast<double>(groups.size());
  if (groups.size() < 3) return 1;
  double correlation = 0;
  for (std::size_t k = 0; k < groups.front().size(); ++k) {
    double mean = 0, squares = 1e-300, products = 0, before = 0;
    for (const std::vector<double>& own : groups) mean += own[k] / count;
    for (const std::vector<double>& own : groups) {
      const double away = own[k] - mean;
      squares += away * away, products += before * away;
      before = away;
    }
    correlation += products / squares / static_cast<double>(groups.front().size());
  }
  const double r = std::clamp(correlation + 1 / count, 0.0, kMostly + kSmallShare);  // 1/count: the mean is their own
  return (1 + r) / (1 - r);
}

Frames frames_of(std::span<const CommonCourse> courses) {
  const auto count = static_cast<Index>(courses.front().modes.size()), number = static_cast<Index>(courses.size());
  Frames frames{MatrixXd(count, number),
                slow_modes(kPlacesOfMode * static_cast<std::size_t>(count), static_cast<std::size_t>(count)),
                {},
                {},
                {}};
  VectorXd variance = VectorXd::Zero(count);
  for (Index frame = 0; frame < number; ++frame) {
    const CommonCourse& course = courses[static_cast<std::size_t>(frame)];
    frames.places.push_back(static_cast<double>(course.place - courses.front().place));
    frames.modes.col(frame) = vector_of(course.modes);
    variance += vector_of(course.variance) / static_cast<double>(number);
  }
  const auto falling = [&](double exponent) {
    VectorXd fall(count);
    for (Index k = 0; k < count; ++k) fall[k] = std::pow(static_cast<double>(k + 1), -2 * exponent);
    return fall;
  };
  const MatrixXd trend = modes_of_trends(frames.slow);
  const double shared = of_dependence(courses.front().groups);
  const std::vector<double> exponents =
      number > 1 ? std::vector{kFallOfModes} : std::vector{kFallOfModes, kFallOfShades};
  for (const double exponent : exponents) {
    const VectorXd fall = falling(exponent);
    for (const double spread : ladder(kLeastSpread, kMostSpread, kSpreads))
      for (const double floor : kFloors) {
        const double away = std::log(spread / kUsualSpread);
        const VectorXd all = spread * spread * fall + shared * variance / static_cast<double>(number);
        frames.still.push_back(spread_of(all.array() + floor * floor, trend, -0.5 * away * away));
      }
  }
  for (const double change : ladder(kLeastChange, kMostChange, number > 1 ? kChanges : 0))
    frames.changing.emplace_back((change * change * falling(kFallOfModes) + variance).cwiseInverse());
  return frames;
}

// Log evidence of modes without a tone, by S and floor, and by change; 0 for one frame.
struct Evidence {
  std::vector<double> still, changing;

  [[nodiscard]] double all() const { return log_sum(still) + log_sum(changing); }
};

Evidence evidence_of(const Frames& frames, const MatrixXd& modes) {
  Evidence result;
  const VectorXd mean = modes.rowwise().mean();
  for (const Spread& spread : frames.still)
    result.still.push_back(spread.log_scale - 0.5 * mean.dot(spread.times(mean).col(0)));
  const MatrixXd rest = modes.colwise() - mean;
  for (const VectorXd& weight : frames.changing) {
    const double squares = (rest.array().square().colwise() * weight.array()).sum();
    result.changing.push_back(0.5 * (static_cast<double>(modes.cols() - 1) * weight.array().log().sum() - squares));
  }
  if (frames.changing.empty()) result.changing.push_back(0);
  return result;
}

// Tones of every frequency and phase step, which one frame does not show, with the logarithms of their probabilities.
std::vector<SlowTone> all_tones(std::size_t rows, std::size_t frames) {
  const double most = most_cycles(rows);
  std::vector<SlowTone> tones;
  for (double cycles = kLeastCycles;; cycles += std::min(kNearCycles * cycles, kNearAtMost)) {
    for (std::size_t k = 0; k < (frames > 1 ? kPhaseSteps : 1); ++k) {
      tones.emplace_back().cycles = cycles;
      if (frames > 1) tones.back().step = kTwoPi * static_cast<double>(k) / static_cast<double>(kPhaseSteps);
    }
    if (!(cycles < most)) break;
  }
  for (SlowTone& tone : tones) tone.log_odds = -std::log(static_cast<double>(tones.size()));
  return tones;
}

// Light and its derivatives by the parameters of the tones, in the logarithm, as modes of each frame.
struct Predicted {
  MatrixXd modes;                    // (modes × frames)
  std::vector<MatrixXd> derivative;  // of each frame: (modes × parameters)
};

// `slow`: (places × modes); `frames`: their places after the first.
Predicted predicted(const MatrixXd& slow, std::span<const double> frames, std::span<const SlowTone> tones) {
  const Index places = slow.rows(), count = static_cast<Index>(tones.size() * kParameters);
  Predicted result{MatrixXd(slow.cols(), static_cast<Index>(frames.size())), {}};
  for (std::size_t frame = 0; frame < frames.size(); ++frame) {
    VectorXd light = VectorXd::Ones(places);
    MatrixXd change(places, count);
    for (Index n = 0; n < places; ++n)
      for (std::size_t k = 0; k < tones.size(); ++k) {
        const SlowTone& tone = tones[k];
        const double place = from_middle(n, places);
        const double angle = kTwoPi * tone.cycles * place + tone.step.value_or(0) * frames[frame];
        const double cosine = std::cos(angle), sine = std::sin(angle);
        const double slope = tone.terms[1] * cosine - tone.terms[0] * sine;
        light[n] += tone.terms[0] * cosine + tone.terms[1] * sine;
        const auto at = static_cast<Index>(k * kParameters);
        change.row(n).segment(at, kParameters) << cosine, sine, slope * kTwoPi * place, slope * frames[frame];
      }
    for (Index n = 0; n < places; ++n) {
      change.row(n) *= light[n] > kLeastLight ? 1 / light[n] : 0;
      light[n] = std::log(std::max(light[n], kLeastLight));
    }
    result.modes.col(static_cast<Index>(frame)) = modes_of_courses(slow, light);
    result.derivative.push_back(modes_of_courses(slow, change));
  }
  return result;
}

// Advance of the phase by `angle`.
Matrix2d rotation(double angle) {
  Matrix2d result;
  result << std::cos(angle), std::sin(angle), -std::sin(angle), std::cos(angle);
  return result;
}

// Normal equations of the terms of the tones of one number of cycles, which are taken for their logarithm.
struct OfCycles {
  std::vector<Matrix2d> still, changing;
  std::vector<Vector2d> pull;   // of what stays
  std::vector<MatrixXd> pulls;  // (2 × frames), of what changes
};

OfCycles equations_of(const Frames& frames, const MatrixXd& residual, double cycles) {
  const SlowTone tone{.cycles = cycles, .step = {}};
  const MatrixXd modes = predicted(frames.slow, std::array{0.0}, {&tone, 1}).derivative.front().leftCols(2);
  const VectorXd mean = residual.rowwise().mean();
  OfCycles result;
  for (const Spread& spread : frames.still) {
    const MatrixXd weighed = spread.times(modes);
    result.still.emplace_back(transposed_product(modes, weighed));
    result.pull.emplace_back(weighed.transpose() * mean);
  }
  for (const VectorXd& weight : frames.changing) {
    const MatrixXd weighed = weight.asDiagonal() * modes;
    result.changing.emplace_back(transposed_product(modes, weighed));
    result.pulls.push_back(transposed_product(weighed, residual.colwise() - mean));
  }
  return result;
}

// A tone that is tried, with the mean of its terms, and its log evidence, that of all S, floors, changes and sizes.
SlowTone compared(SlowTone tone, const OfCycles& equations, const Frames& frames, const Evidence& none) {
  std::vector<Matrix2d> turns;
  Matrix2d still = Matrix2d::Zero();
  for (const double place : frames.places) {
    turns.push_back(rotation(tone.step.value_or(0) * place));
    still += turns.back() / static_cast<double>(frames.places.size());
  }
  std::vector<Matrix2d> changing(none.changing.size(), Matrix2d::Zero());
  std::vector<Vector2d> pulls(none.changing.size(), Vector2d::Zero());
  for (std::size_t change = 0; change < equations.changing.size(); ++change)
    for (std::size_t frame = 0; frame < turns.size(); ++frame) {
      const Matrix2d moving = turns[frame] - still;
      changing[change] += moving.transpose() * equations.changing[change] * moving;
      pulls[change] += moving.transpose() * equations.pulls[change].col(static_cast<Index>(frame));
    }
  std::vector<double> exponents, factors;  // of the evidence
  std::vector<Vector2d> terms;
  for (std::size_t k = 0; k < none.still.size(); ++k) {
    const Matrix2d normal = still.transpose() * equations.still[k] * still;
    const Vector2d pull = still.transpose() * equations.pull[k];
    for (std::size_t change = 0; change < changing.size(); ++change)
      for (const double size : kSizes) {
        const Matrix2d all = normal + changing[change] + Matrix2d::Identity() / (size * size);
        const double determinant = all(0, 0) * all(1, 1) - all(0, 1) * all(1, 0);
        const Vector2d right = pull + pulls[change];
        const Vector2d solution((all(1, 1) * right[0] - all(0, 1) * right[1]) / determinant,
                                (all(0, 0) * right[1] - all(1, 0) * right[0]) / determinant);
        exponents.push_back(none.still[k] + none.changing[change] + 0.5 * right.dot(solution));
        factors.push_back(1 / (std::sqrt(determinant) * size * size * static_cast<double>(kSizes.size())));
        terms.push_back(solution);
      }
  }
  const double most = *std::ranges::max_element(exponents);
  double sum = 0;
  Vector2d mean = Vector2d::Zero();
  for (std::size_t k = 0; k < terms.size(); ++k) {
    const double evidence = factors[k] * std::exp(exponents[k] - most);
    sum += evidence;
    mean += evidence * terms[k];
  }
  tone.terms = {mean[0] / sum, mean[1] / sum};
  tone.log_odds += most + std::log(sum);
  return tone;
}

// The likeliest of the tones that are tried, with the odds of all together against none.
SlowTone likeliest(const Frames& frames, const MatrixXd& residual, std::vector<SlowTone> tones) {
  const Evidence none = evidence_of(frames, residual);
  std::vector<double> evidence;
  OfCycles equations;
  double cycles = 0;  // that they are of; above 0
  for (SlowTone& tone : tones) {
    check_interrupt();
    if (tone.cycles != cycles) equations = equations_of(frames, residual, tone.cycles);
    cycles = tone.cycles;
    tone = compared(tone, equations, frames, none);
    evidence.push_back(tone.log_odds);
  }
  SlowTone best = tones[static_cast<std::size_t>(std::ranges::max_element(evidence) - evidence.begin())];
  best.log_odds = log_sum(evidence) - none.all();
  return best;
}

MatrixXd without(const Frames& frames, std::span<const SlowTone> tones) {
  return tones.empty() ? frames.modes : frames.modes - predicted(frames.slow, frames.places, tones).modes;
}

// Normal equations of one step of Gauss and Newton, and the sum of squares before it.
struct Equations {
  MatrixXd normal;
  VectorXd right;
  double squares = 0;
};

Equations equations_at(const Frames& frames, const Spread& still, const VectorXd* changing,
                       std::span<const SlowTone> tones) {
  const Predicted now = predicted(frames.slow, frames.places, tones);
  const MatrixXd residual = frames.modes - now.modes;
  const VectorXd mean = residual.rowwise().mean();
  MatrixXd slope = MatrixXd::Zero(mean.size(), now.derivative.front().cols());
  for (const MatrixXd& own : now.derivative) slope += own / static_cast<double>(now.derivative.size());
  const MatrixXd weighed = still.times(slope);
  Equations result{transposed_product(slope, weighed), weighed.transpose() * mean, mean.dot(still.times(mean).col(0))};
  for (std::size_t frame = 0; changing != nullptr && frame < now.derivative.size(); ++frame) {
    const MatrixXd apart = now.derivative[frame] - slope;
    const VectorXd rest = residual.col(static_cast<Index>(frame)) - mean;
    const MatrixXd heavy = changing->asDiagonal() * apart;
    result.normal += transposed_product(apart, heavy);
    result.right += heavy.transpose() * rest;
    result.squares += rest.dot(changing->cwiseProduct(rest));
  }
  return result;
}

VectorXd parameters_of(std::span<const SlowTone> tones) {
  VectorXd values(static_cast<Index>(tones.size() * kParameters));
  for (std::size_t k = 0; k < tones.size(); ++k)
    values.segment(static_cast<Index>(k * kParameters), kParameters) << tones[k].terms[0], tones[k].terms[1],
        tones[k].cycles, tones[k].step.value_or(0);
  return values;
}

std::vector<SlowTone> with_parameters(std::vector<SlowTone> tones, const VectorXd& values) {
  for (std::size_t k = 0; k < tones.size(); ++k) {
    const auto at = static_cast<Index>(k * kParameters);
    tones[k].terms = {values[at], values[at + 1]};
    tones[k].cycles = std::max(values[at + 2], kLeastCycles);
    if (tones[k].step) tones[k].step = values[at + 3];
  }
  return tones;
}

// Tones with the variances of their terms by damped Gauss–Newton (Levenberg and Marquardt) with the likeliest S, floor
// and change. `deviations`: expected of the parameters of each tone from those of the start; of the terms from 0 where
// `about_zero`.
std::vector<SlowTone> fitted(const Frames& frames, const std::vector<SlowTone>& start, const Vector4d& deviations,
                             bool about_zero) {
  const Evidence evidence = evidence_of(frames, without(frames, start));
  const auto likely = [](const std::vector<double>& all) {
    return static_cast<std::size_t>(std::ranges::max_element(all) - all.begin());
  };
  const Spread& still = frames.still[likely(evidence.still)];
  const VectorXd* const changing = frames.changing.empty() ? nullptr : &frames.changing[likely(evidence.changing)];
  const VectorXd first = parameters_of(start);
  VectorXd centre = first, hold(first.size());
  for (Index at = 0; at < first.size(); at += kParameters) {
    if (about_zero) centre.segment(at, 2).setZero();
    hold.segment(at, kParameters) = deviations.cwiseAbs2().cwiseInverse();
  }
  VectorXd now = first;
  const auto at = [&](const VectorXd& values) {
    Equations all = equations_at(frames, still, changing, with_parameters(start, values));
    all.squares += hold.dot((values - centre).cwiseAbs2());
    all.right -= hold.cwiseProduct(values - centre);
    all.normal.diagonal() += hold;
    return all;
  };
  Equations best = at(now);
  for (double damping = 1e-3, step = 0; step < kMaxIterations && damping < 1e6; ++step) {
    MatrixXd damped = best.normal;
    damped.diagonal() *= 1 + damping;
    const VectorXd moved = now + solve_positive_definite(damped, best.right).col(0);
    Equations tried = at(moved);
    const double gain = best.squares - tried.squares;
    damping *= gain > 0 ? 0.25 : 8;
    if (!(gain > 0)) continue;
    now = moved;
    best = std::move(tried);
    if (gain < 1e-6 * best.squares) break;
  }
  std::vector<SlowTone> tones = with_parameters(start, now);
  const MatrixXd covariance = inverse(best.normal);
  for (std::size_t k = 0; k < tones.size(); ++k) {
    const auto place = static_cast<Index>(k * kParameters);
    tones[k].variance = {covariance(place, place), covariance(place + 1, place + 1)};
  }
  return tones;
}

// The likeliest of the tones that are tried joins the others, and all are fitted together.
std::vector<SlowTone> joined(const Frames& frames, std::vector<SlowTone> tones, std::vector<SlowTone> tried) {
  tones.push_back(likeliest(frames, without(frames, tones), std::move(tried)));
  const double step = frames.places.size() > 1 ? kTwoPi / static_cast<double>(kPhaseSteps) : kStays;
  return fitted(frames, tones, {kSizes.back(), kSizes.back(), kNearAtMost, step}, true);
}

}  // namespace

std::vector<SlowTone> find_slow_tones(std::span<const CommonCourse> courses, std::size_t rows,
                                      std::span<const SlowTone> near) {
  const Frames frames = frames_of(courses);
  std::vector<SlowTone> found;
  for (const SlowTone& tone : near) {
    if (courses.size() > 1 && !tone.step) break;  // that of a single frame; another search finds its step
    found = joined(frames, std::move(found), {{.cycles = tone.cycles, .step = tone.step}});
  }
  std::vector<SlowTone> tried = all_tones(rows, courses.size());
  // A second one moves in several frames; in one it may be shades, or what a tone curve makes of the first one.
  const std::size_t most = courses.size() == 1 ? 1 : kMostTones;
  while (found.size() < most && (near.empty() || courses.size() < kMostSlowFrames)) {
    for (const SlowTone& own : found)
      std::erase_if(tried, [&](const SlowTone& other) { return std::abs(other.cycles - own.cycles) < kMostly; });
    if (tried.empty()) break;
    std::vector<SlowTone> more = joined(frames, found, tried);
    const bool is_sure = more.back().is_sure();
    if (is_sure || found.empty()) found = std::move(more);
    if (!is_sure) break;
  }
  return found;
}

VectorXd modes_of_light(std::span<const SlowTone> tones, std::size_t count) {
  if (tones.empty()) return VectorXd::Zero(static_cast<Index>(count));
  return predicted(slow_modes(kPlacesOfMode * count, count), std::array{0.0}, tones).modes;
}

std::vector<SlowTone> refitted_tones(std::span<const CommonCourse> courses, const std::vector<SlowTone>& tones,
                                     double deviation) {
  return fitted(frames_of(courses), tones, {deviation, deviation, kStays, kStays}, false);
}

}  // namespace ocisac
