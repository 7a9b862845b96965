#include "ocisac/cleaning/slow_light.hpp"

#include <algorithm>
#include <cmath>

#include "cleaning/block_shares.hpp"
#include "cleaning/cleaned_picture.hpp"
#include "cleaning/merged_blocks.hpp"
#include "cleaning/quantile.hpp"
#include "cleaning/slow_tones.hpp"
#include "core/check_interrupt.hpp"
#include "core/levels.hpp"
#include "core/linear_algebra.hpp"
#include "ocisac/cleaning/judge_cleaning.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

using Eigen::ArrayXXd;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kLikelyOdds = 10, kSureOdds = 400;  // of a light against none: it is said, it is removed
constexpr double kMaxWorse = 0.25;                   // of the groups of columns
constexpr double kLeastMove = 0.05;                  // cycles from frame to frame
constexpr double kByChance = 13.8;                   // chi square of two terms that one in a thousand exceeds
constexpr double kBetweenCells = 0.15;  // standard deviation of a share from its neighbours; from 1 it is 1
constexpr double kClearlyLess = 0.8;    // of what one share leaves; by chance 0.9
constexpr int kSteps = 4;
constexpr const char* kNotSure = "slow bands that the picture's own shades may be";
constexpr const char* kDisagrees = "slow bands that are others than those of the frames before";

// The course of one group of columns.
CommonCourse course_of(const CommonCourse& course, std::size_t group) {
  CommonCourse own{course.groups[group], course.variance, course.groups, course.place};
  for (double& value : own.variance) value *= static_cast<double>(course.groups.size());
  return own;
}

// The tones of each colour: those of all, and what the colour's course differs by; less than a cycle of that is like a
// shade of the colour.
std::vector<std::vector<SlowTone>> tones_of_colours(std::span<const BandedPicture> colours, const CommonCourse& all,
                                                    const std::vector<SlowTone>& tones) {
  if (colours.size() == 1 || tones.front().cycles < 1) return std::vector(colours.size(), tones);
  const VectorXd common = modes_of_light(tones, all.modes.size());
  std::vector<std::vector<SlowTone>> found;
  for (const BandedPicture& colour : colours) {
    CommonCourse own = common_course(std::span(&colour, 1), &all);
    own.modes = values_of(vector_of(own.modes) + common - vector_of(all.modes));
    own.variance = values_of(2 * vector_of(all.variance));
    found.push_back(refitted_tones({&own, 1}, tones, kMostly * swing_of(tones)));
  }
  return found;
}

VectorXd terms_of(const std::vector<SlowTone>& tones) {
  VectorXd terms(2 * tones.size());
  for (std::size_t k = 0; k < tones.size(); ++k)
    terms.segment<2>(static_cast<Index>(2 * k)) << tones[k].terms[0], tones[k].terms[1];
  return terms;
}

// Compares the tones, as in the first of the frames, with those of each group of columns.
SlowVerdict agreement_of_groups(std::span<const CommonCourse> courses, const std::vector<SlowTone>& tones) {
  std::size_t count = courses.front().groups.size();
  for (const CommonCourse& course : courses) count = std::min(count, course.groups.size());
  double before = 0, after = 0, grown = 0;
  const VectorXd all = terms_of(tones);
  VectorXd mean = VectorXd::Zero(all.size());
  for (std::size_t group = 0; group < count; ++group) {
    std::vector<CommonCourse> own;
    for (const CommonCourse& course : courses) own.push_back(course_of(course, group));
    const VectorXd terms = terms_of(refitted_tones(own, tones, kMostly));
    const double energy = terms.squaredNorm(), left = (terms - all).squaredNorm();
    mean += terms / static_cast<double>(count);
    before += energy;
    after += left;
    grown += left > energy ? 1 : 0;
  }
  before = std::max(before, 1e-300);
  double doubt = 0;
  for (const SlowTone& tone : tones) doubt += tone.variance[0] + tone.variance[1];
  return {std::sqrt(std::min(after / before, doubt / std::max(all.squaredNorm(), 1e-300))),
          grown / static_cast<double>(count), mean.squaredNorm() * static_cast<double>(count) / before};
}

// Inverse covariance of the shares of cells, `across` in a row of them.
MatrixXd prior_of(Index cells, Index across) {
  MatrixXd prior = MatrixXd::Identity(cells, cells);
  const auto join = [&](Index a, Index b) {
    const double weight = 1 / (kBetweenCells * kBetweenCells);
    prior(a, a) += weight;
    prior(b, b) += weight;
    prior(a, b) -= weight;
    prior(b, a) -= weight;
  };
  for (Index cell = 0; cell < cells; ++cell) {
    if ((cell + 1) % across != 0) join(cell, cell + 1);
    if (cell + across < cells) join(cell, cell + across);
  }
  return prior;
}

ArrayXXd centred(const ArrayXXd& values) { return values.colwise() - values.rowwise().mean(); }

// Shares of the light in the cells of the courses: in consecutive frames the phase moves and the picture hardly, so
// that the mean of a cell changes by its share. `tones`: as in the first of the frames. Empty where cells of their own
// explain the changes no better than one share, or where the frames are too few.
std::vector<double> slow_shares(std::span<const CommonCourse> courses, const std::vector<SlowTone>& tones,
                                std::size_t rows) {
  const CommonCourse& first = courses.front();
  const auto cells = static_cast<Index>(first.cells.size()), frames = static_cast<Index>(courses.size());
  if (courses.size() < kFewFrames || cells == 0) return {};
  const auto across = static_cast<Index>(first.cells.size() / blocks_of(rows, first.cell_rows));
  ArrayXXd level(cells, frames), change(cells, frames);  // of the light, from its mean
  for (Index frame = 0; frame < frames; ++frame) {
    const CommonCourse& course = courses[static_cast<std::size_t>(frame)];
    if (static_cast<Index>(course.cells.size()) != cells) return {};
    const std::vector<double> light =
        means_of_rows(light_of(in_frame(tones, course.place - first.place), rows), rows, first.cell_rows);
    for (Index cell = 0; cell < cells; ++cell) {
      level(cell, frame) = course.cells[static_cast<std::size_t>(cell)];
      change(cell, frame) = light[static_cast<std::size_t>(cell / across)] - 1;
    }
  }
  level = centred(level);
  const MatrixXd prior = prior_of(cells, across);
  VectorXd share = VectorXd::Ones(cells);
  const auto left = [&] { return (1 + change.colwise() * share.array()).max(kLeastLight).eval(); };
  const auto residual = [&] { return (level - centred(left().log())).eval(); };
  double noise_of_one = 0, before = 0;
  for (int step = 0; step < kSteps; ++step) {
    const ArrayXXd rest = residual(), slope = centred(change / left()), squares = rest.square();
    const double noise = quantile({squares.data(), static_cast<std::size_t>(squares.size())}, 0.5) /
                             (kMedianMagnitude * kMedianMagnitude) +
                         kLeastModeVariance;
    if (step == 0) {
      noise_of_one = noise;
      before = (1 + squares / noise).log().sum();
    }
    const ArrayXXd weight = (squares + noise).inverse();
    MatrixXd normal = prior;
    normal.diagonal() += (weight * slope.square()).rowwise().sum().matrix();
    const VectorXd right = (weight * slope * rest).rowwise().sum().matrix() - prior * (share - VectorXd::Ones(cells));
    share = (share + VectorXd(solve_positive_definite(normal, right))).cwiseMax(0);
  }
  if (!((1 + residual().square() / noise_of_one).log().sum() < kClearlyLess * before)) return {};
  return {share.data(), share.data() + share.size()};
}

// `is_even`: all of the picture has one share.
std::string objection_to(const SlowVerdict& verdict, bool is_even) {
  if (verdict.level < kMinLevel) return "slow bands that tilt or curve";
  return is_even && verdict.worse > kMaxWorse ? "slow bands of a light on some of the columns" : "";
}

// Chi square of the difference of two frames with the tones and without them; what chance may change it by.
struct Difference {
  double with = 0, without = 0, chance = 0;
  double seen = 1;  // of the tones in the second frame, if they are in the first
  double move = 0;  // chi square of the difference of the tones

  // By most of it: the frames are of one scene.
  [[nodiscard]] bool is_less() const { return without + std::max(chance, kMostly * with) <= with; }
  // The phase stands: neither the tones nor the frames differ by them.
  [[nodiscard]] bool stands() const { return move <= chance && std::abs(seen - 1) < kSmallShare; }
};

// `first`: the tones in the frame of number `place`.
Difference difference_of(const CommonCourse& before, const CommonCourse& course, const std::vector<SlowTone>& first,
                         std::ptrdiff_t place) {
  const VectorXd then = modes_of_light(in_frame(first, before.place - place), course.modes.size());
  const VectorXd now = modes_of_light(in_frame(first, course.place - place), course.modes.size());
  const VectorXd certainty = (vector_of(course.variance) + vector_of(before.variance)).cwiseInverse();
  const VectorXd change = vector_of(course.modes) - vector_of(before.modes);
  const auto squares = [&](const VectorXd& modes) { return certainty.dot(modes.cwiseAbs2()); };
  const double seen = certainty.cwiseProduct(now).dot(change + then) / (squares(now) + 1e-300);
  return {squares(change), squares(change - now + then), kByChance * static_cast<double>(first.size()), seen,
          squares(now - then)};
}

// Energy of what differs from frame to frame without the tones.
double change_of(std::span<const CommonCourse> courses, const std::vector<SlowTone>& first) {
  const std::size_t count = courses.front().modes.size();
  MatrixXd rest(count, courses.size());
  for (Index k = 0; k < rest.cols(); ++k) {
    const CommonCourse& course = courses[static_cast<std::size_t>(k)];
    rest.col(k) =
        vector_of(course.modes) - modes_of_light(in_frame(first, course.place - courses.front().place), count);
  }
  return (rest.colwise() - VectorXd(rest.rowwise().mean())).squaredNorm();
}

// The energy of what the columns have in common is that of the tones and of the rest, unless these cancel: shades, or
// another lamp, hide the tones, or the lamp is off. Shades may hide tones that leave nothing of what differs from frame
// to frame (`left`: share of it), if the energy falls; if they leave some, another lamp moves, and it must halve.
// Less than a cycle changes the mean of a frame most, which is not compared.
bool would_grow(const CommonCourse& course, const std::vector<SlowTone>& tones, double left) {
  const VectorXd modes = vector_of(course.modes), light = modes_of_light(tones, course.modes.size());
  const double removed = light.squaredNorm(), before = modes.squaredNorm(), after = (modes - light).squaredNorm();
  if (left > kSmallShare) return after > kMostly * before;
  return tones.front().cycles >= 1 - kNearAtMost && kMostly * (after + removed) > before &&
         (left > kNextToNone || after > before);
}

// The tones do not explain how the last of the frames differs from the one before, or, of others, half of what they
// change.
bool are_others(std::span<const CommonCourse> frames, const std::vector<SlowTone>& first) {
  Difference last;
  for (std::size_t k = 1; k < frames.size(); ++k) {
    last = difference_of(frames[k - 1], frames[k], first, frames.front().place);
    if (last.without + kMostly * last.move > last.with + last.chance) return true;
  }
  return frames.size() > 1 && !last.is_less();
}

}  // namespace

double SlowTone::amplitude() const { return std::hypot(terms[0], terms[1]); }

bool SlowTone::is_sure() const {
  const double error = std::sqrt((variance[0] + variance[1]) / 2);
  // Less than a cycle that stays is like a shade of the picture.
  const double moves = step ? std::abs(std::remainder(*step, kTwoPi)) / (kTwoPi) : 0;
  return log_odds > std::log(kSureOdds) && amplitude() > kWeak * error && cycles > 1.1 * kLeastCycles &&
         (cycles >= 1 || moves > kLeastMove);
}

SlowTone SlowTone::in_frame(std::ptrdiff_t frame) const {
  SlowTone turned = *this;
  const double angle = step.value_or(0) * static_cast<double>(frame);
  turned.terms = {std::cos(angle) * terms[0] + std::sin(angle) * terms[1],
                  std::cos(angle) * terms[1] - std::sin(angle) * terms[0]};
  return turned;
}

std::vector<SlowTone> in_frame(std::vector<SlowTone> tones, std::ptrdiff_t frame) {
  for (SlowTone& tone : tones) tone = tone.in_frame(frame);
  return tones;
}

std::vector<double> light_of(std::span<const SlowTone> tones, std::size_t rows) {
  std::vector<double> light(rows, 1.0);
  for (std::size_t n = 0; n < rows; ++n) {
    for (const SlowTone& tone : tones) {
      const double angle = kTwoPi * tone.cycles * ((static_cast<double>(n) + 0.5) / static_cast<double>(rows) - 0.5);
      light[n] += tone.terms[0] * std::cos(angle) + tone.terms[1] * std::sin(angle);
    }
    light[n] = std::max(light[n], kLeastLight);
  }
  return light;
}

double swing_of(std::span<const SlowTone> tones) {
  double sum = 0;
  for (const SlowTone& tone : tones) sum += tone.amplitude();
  return sum;
}

std::vector<SlowLight> find_slow_lights(std::span<const std::vector<BandedPicture>> frames,
                                        const EarlierFrames& earlier, std::span<const SlowTone> near) {
  require(!frames.empty(), "frames", 0, "at least one");
  const std::size_t rows = frames.front().empty() ? 0 : frames.front().front().rows;
  std::vector<CommonCourse> courses = earlier.courses;
  for (const std::vector<BandedPicture>& colours : frames) {
    courses.push_back(common_course(colours));
    courses.back().place = earlier.next + static_cast<std::ptrdiff_t>(courses.size() - 1 - earlier.courses.size());
  }
  for (const CommonCourse& course : courses)
    require(course.modes.size() == courses.back().modes.size(), "earlier", course.modes.size(),
            "courses of as many modes");
  std::vector<SlowTone> known(near.begin(), near.end());  // as in frame `place_of_known`
  std::ptrdiff_t place_of_known = earlier.courses.empty() ? 0 : earlier.courses.back().place;
  std::optional<std::size_t> compared;  // the first of the frames that `first` and `verdict` are of
  std::vector<SlowTone> first;
  SlowVerdict verdict;
  std::vector<double> shares;
  double left = 0;
  bool is_sure = false;
  // Two frames differ alike where a light moves and where it is switched.
  const std::size_t most = courses.size() == 2 ? 1 : kMostSlowFrames;
  std::vector<SlowLight> result;
  for (std::size_t frame = earlier.courses.size(); frame < courses.size(); ++frame) {
    check_interrupt();
    const std::size_t last = courses.size() - std::min(courses.size(), most);
    const std::size_t start = most == 1 ? frame : std::min(frame - std::min(frame, most / 2), last);
    if (compared != start) {
      const auto these = std::span<const CommonCourse>(courses).subspan(start, std::min(most, courses.size() - start));
      first = find_slow_tones(these, rows, in_frame(known, these.front().place - place_of_known));
      is_sure = std::ranges::all_of(first, &SlowTone::is_sure) &&
                (first.front().cycles >= 1 - kNearAtMost || these.size() > kFewFrames);
      left = change_of(these, first) / (change_of(these, {}) + kLeastModeVariance);
      verdict = is_sure ? agreement_of_groups(these, first) : SlowVerdict{};
      shares = is_sure ? slow_shares(these, first, rows) : std::vector<double>{};
      known = first;
      std::erase_if(known, [](const SlowTone& tone) { return !tone.is_sure(); });
      place_of_known = these.front().place;
      compared = start;
    }
    const std::vector<SlowTone> tones = in_frame(first, courses[frame].place - courses[start].place);
    const SlowTone& main = tones.front();
    const std::vector<BandedPicture>& colours = frames[frame - earlier.courses.size()];
    const bool is_other =
        is_sure && are_others(std::span<const CommonCourse>(courses).subspan(start, frame - start + 1), first);
    result.push_back({is_sure ? tones_of_colours(colours, courses[frame], tones) : std::vector(colours.size(), tones),
                      tones, courses[frame], left, main.log_odds > std::log(kLikelyOdds) ? main.amplitude() : 0,
                      verdict,
                      !is_sure                                  ? kNotSure
                      : is_other                                ? kDisagrees
                      : would_grow(courses[frame], tones, left) ? kWouldGrow
                                                                : objection_to(verdict, shares.empty()),
                      shares});
  }
  const bool is_other = std::ranges::any_of(result, [](const SlowLight& one) { return one.objection == kDisagrees; });
  if (!is_other || earlier.courses.empty()) return result;
  result = find_slow_lights(frames, {{}, earlier.next});
  for (SlowLight& one : result) one.is_first = true;
  return result;
}

SlowLight slow_light_before(const std::vector<BandedPicture>& colours, const SlowLight& later, std::ptrdiff_t ago) {
  CommonCourse all = common_course(colours);
  require(all.modes.size() == later.course.modes.size(), "colours", colours.front().rows, "as many rows");
  all.place = later.course.place - ago;
  SlowLight light = later;
  light.common = in_frame(later.common, -ago);
  light.tones = tones_of_colours(colours, all, light.common);
  const Difference difference = difference_of(all, later.course, light.common, all.place);
  if (would_grow(all, light.common, light.left)) light.objection = kWouldGrow;
  if (!difference.is_less() && !difference.stands()) light.objection = kDisagrees;
  light.course = std::move(all);
  return light;
}

}  // namespace ocisac
