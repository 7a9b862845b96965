#include "ocisac/cleaning/slow_light.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "cleaning/slow_tones.hpp"
#include "core/check_interrupt.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr double likely = 10, sure = 400;  // odds of a light against none: it is said, it is removed
constexpr double clear = 3;                // standard errors of its amplitude
constexpr double colours_differ = 0.35;    // relative deviation of a colour's tone from that of all
constexpr double of_groups = 0.5;          // expected size of the terms of a group of columns: hardly a bound
constexpr double min_level = 0.25, max_worse = 0.25;
constexpr double by_chance = 13.8;  // chi square of two terms that one in a thousand exceeds
constexpr std::size_t places_of_cycle = 256;
constexpr const char* not_sure = "slow bands that the picture's own shades may be";
constexpr const char* disagrees = "slow bands that are others than those of the frames before";

double square(double value) { return value * value; }

// The course of one group of columns.
CommonCourse course_of(const CommonCourse& course, std::size_t group) {
  CommonCourse own{course.groups[group], course.variance, course.groups, course.place};
  for (double& value : own.variance) value *= static_cast<double>(course.groups.size());
  return own;
}

// The difference of the logarithms.
CommonCourse difference(const CommonCourse& one, const CommonCourse& other) {
  CommonCourse result = one;
  for (std::size_t k = 0; k < one.modes.size(); ++k) {
    result.modes[k] -= other.modes[k];
    result.variance[k] += other.variance[k];
    for (std::size_t group = 0; group < one.groups.size(); ++group) result.groups[group][k] -= other.groups[group][k];
  }
  return result;
}

// The tone of each colour: that of all, and what the colour's course differs by.
std::vector<SlowTone> tones_of_colours(const CommonCourse& all, std::span<const CommonCourse> colours,
                                       const SlowTone& tone) {
  if (colours.size() == 1) return {tone};
  std::vector<SlowTone> found;
  const double differ = colours_differ * tone.amplitude();
  for (const CommonCourse& own : colours) {
    const CommonCourse apart = difference(own, all);
    const SlowTone change = refitted_tone({&apart, 1}, tone, {differ, usual_harmonic * differ});
    found.push_back(tone);
    for (std::size_t k = 0; k < tone.terms.size(); ++k) found.back().terms[k] += change.terms[k];
  }
  return found;
}

// Compares the tone, as in the first of the frames, with that of each group of columns.
SlowVerdict agreement_of_groups(std::span<const CommonCourse> courses, const SlowTone& tone) {
  std::size_t count = courses.front().groups.size();
  for (const CommonCourse& course : courses) count = std::min(count, course.groups.size());
  double before = 0, after = 0, grown = 0;
  std::array<double, 2> mean{};
  for (std::size_t group = 0; group < count; ++group) {
    std::vector<CommonCourse> own;
    for (const CommonCourse& course : courses) own.push_back(course_of(course, group));
    const std::array<double, 4> terms = refitted_tone(own, tone, {of_groups}).terms;
    const double energy = square(terms[0]) + square(terms[1]);
    const double left = square(terms[0] - tone.terms[0]) + square(terms[1] - tone.terms[1]);
    before += energy;
    after += left;
    grown += left > energy ? 1 : 0;
    for (std::size_t k = 0; k < mean.size(); ++k) mean[k] += terms[k] / static_cast<double>(count);
  }
  before = std::max(before, 1e-300);
  return {std::sqrt(after / before), grown / static_cast<double>(count),
          (square(mean[0]) + square(mean[1])) * static_cast<double>(count) / before};
}

std::string objection_to(const SlowVerdict& verdict) {
  if (verdict.level < min_level) return "slow bands that tilt or curve";
  return verdict.worse > max_worse ? "slow bands of a light on some of the columns" : "";
}

struct FrameCourses {
  CommonCourse all;
  std::vector<CommonCourse> colours;
};

FrameCourses courses_of(const std::vector<BandedPicture>& colours) {
  require(!colours.empty(), "colours", 0, "at least one");
  FrameCourses result;
  for (const BandedPicture& colour : colours) result.colours.push_back(common_course(colour));
  if (colours.size() == 1) {
    result.all = result.colours.front();
    return result;
  }
  std::vector<double> light(colours.front().light.size()), variance(light.size());
  for (const BandedPicture& colour : colours) {
    require(colour.light.size() == light.size(), "colours", colour.light.size(), "pictures of one shape");
    for (std::size_t i = 0; i < light.size(); ++i) {
      light[i] += colour.light[i];
      variance[i] += colour.variance[i];
    }
  }
  result.all = common_course({light, variance, 1, colours.front().rows, colours.front().columns});
  return result;
}

// Light at equal places over so many cycles of a tone about the middle, over its mean in a cycle.
std::vector<double> light_over(const SlowTone& tone, double cycles, std::size_t places) {
  const auto light_at = [&](double place) {
    const double angle = 2 * std::numbers::pi * place;
    return std::exp(tone.terms[0] * std::cos(angle) + tone.terms[1] * std::sin(angle) +
                    tone.terms[2] * std::cos(2 * angle) + tone.terms[3] * std::sin(2 * angle));
  };
  double mean = 0;
  for (std::size_t k = 0; k < places_of_cycle; ++k)
    mean += light_at(static_cast<double>(k) / places_of_cycle) / places_of_cycle;
  std::vector<double> light(places);
  for (std::size_t n = 0; n < places; ++n)
    light[n] = light_at(cycles * ((static_cast<double>(n) + 0.5) / static_cast<double>(places) - 0.5)) / mean;
  return light;
}

// The frame's own course, without those of other frames, agrees with the tone: its terms are within what the picture
// may add to them.
bool agrees(const CommonCourse& course, const SlowTone& tone) {
  const SlowTone own = refitted_tone({&course, 1}, tone, {of_groups});
  double distance = 0;
  for (std::size_t k = 0; k < 2; ++k) distance += square(own.terms[k] - tone.terms[k]) / own.variance[k];
  return distance < by_chance;
}

}  // namespace

double SlowTone::amplitude() const { return std::hypot(terms[0], terms[1]); }

bool SlowTone::is_sure() const {
  const double error = std::sqrt((variance[0] + variance[1]) / 2);
  return log_odds > std::log(sure) && amplitude() > clear * error && cycles > 1.1 * least_cycles;
}

SlowTone SlowTone::in_frame(std::ptrdiff_t frame) const {
  SlowTone turned = *this;
  for (std::size_t harmonic = 0; harmonic < 2; ++harmonic) {
    const double angle = static_cast<double>(harmonic + 1) * step.value_or(0) * static_cast<double>(frame);
    const double cosine = terms[2 * harmonic], sine = terms[2 * harmonic + 1];
    turned.terms[2 * harmonic] = std::cos(angle) * cosine + std::sin(angle) * sine;
    turned.terms[2 * harmonic + 1] = std::cos(angle) * sine - std::sin(angle) * cosine;
  }
  return turned;
}

std::vector<double> SlowTone::light(std::size_t rows) const { return light_over(*this, cycles, rows); }

std::vector<double> SlowTone::cycle() const { return light_over(*this, 1, places_of_cycle); }

std::vector<SlowLight> find_slow_lights(std::span<const std::vector<BandedPicture>> frames, const Camera& camera,
                                        const EarlierFrames& earlier, const std::optional<SlowTone>& near) {
  require(!frames.empty(), "frames", 0, "at least one");
  const std::size_t rows = frames.front().empty() ? 0 : frames.front().front().rows;
  std::vector<CommonCourse> courses = earlier.courses;
  std::vector<std::vector<CommonCourse>> of_colours;
  for (const std::vector<BandedPicture>& colours : frames) {
    FrameCourses found = courses_of(colours);
    found.all.place = earlier.next + static_cast<std::ptrdiff_t>(of_colours.size());
    courses.push_back(std::move(found.all));
    of_colours.push_back(std::move(found.colours));
  }
  for (const CommonCourse& course : courses)
    require(course.modes.size() == courses.back().modes.size(), "earlier", course.modes.size(),
            "courses of as many modes");
  std::optional<SlowTone> known = near;
  std::optional<std::size_t> compared;  // the first of the frames that `first` and `verdict` are of
  SlowTone first;
  SlowVerdict verdict;
  std::vector<SlowLight> result;
  for (std::size_t frame = earlier.courses.size(); frame < courses.size(); ++frame) {
    check_interrupt();
    const std::size_t last = courses.size() - std::min(courses.size(), most_slow_frames);
    const std::size_t start = std::min(frame - std::min(frame, most_slow_frames / 2), last);
    if (compared != start) {
      const auto these =
          std::span<const CommonCourse>(courses).subspan(start, std::min(most_slow_frames, courses.size() - start));
      first = find_slow_tone(these, rows, camera, known);
      verdict = agreement_of_groups(these, first);
      known = first.is_sure() ? std::optional(first) : std::nullopt;
      compared = start;
    }
    const SlowTone tone = first.in_frame(courses[frame].place - courses[start].place);
    result.push_back({tones_of_colours(courses[frame], of_colours[frame - earlier.courses.size()], tone),
                      courses[frame], tone.log_odds > std::log(likely) ? tone.amplitude() : 0, verdict,
                      !tone.is_sure()                ? not_sure
                      : agrees(courses[frame], tone) ? objection_to(verdict)
                                                     : disagrees});
  }
  const bool is_other = std::ranges::any_of(result, [](const SlowLight& one) { return one.objection == disagrees; });
  if (!is_other || earlier.courses.empty()) return result;
  result = find_slow_lights(frames, camera, {{}, earlier.next});
  for (SlowLight& one : result) one.is_first = true;
  return result;
}

}  // namespace ocisac
