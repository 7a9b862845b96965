#include "light/waveform_elements.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/light/exposure_response.hpp"

namespace ocisac {

namespace {

constexpr double kMaxTimeConstant = 1000;  // chips
constexpr double kDecayed = 40;            // time constants after which a decay is below the resolution of a double

TimeLine delayed(TimeLine line, double delay) {
  line.origin = line.origin - DoubleDouble{delay, 0};
  return line;
}

Exposures delayed(const Exposures& exposures, double delay) {
  return {delayed(exposures.line, delay), exposures.exposure, exposures.instants};
}

// Cycles of a set of exposures, counted as they are for one of them and as kernels need them for many.
class CycleCounts {
 public:
  CycleCounts(double rate, const Exposures& exposures, DoubleDouble offset, const char* argument)
      : counter_(DoubleDouble{rate, 0}, exposures.line, offset), instants_(exposures.instants) {
    counter_.require_countable(instants_.first(), instants_.last(), argument);
  }

  Position at(std::size_t i) const { return counter_.at(instants_.x()[i]); }
  const CycleCounter& counter() const { return counter_; }

  kernels::Cycles from(std::size_t first, std::size_t count, bool fractions) const {
    kernels::Cycles cycles = instants_.counted(fractions, counter_.step(), first, count);
    cycles.origin = counter_.origin_rest(cycles.grid);
    return cycles;
  }

  bool are_even() const { return instants_.is_even(); }
  // Cycles between neighbouring exposures, where they are even.
  double per_exposure() const {
    const auto x = instants_.x();
    return x.size() > 1 ? (x[1] - x[0]) * counter_.step().high : 0;
  }

 private:
  CycleCounter counter_;
  Instants& instants_;
};

// --- Tone: A/2·(1 + depth·sinc(f T_e)·cos(phase in mid-exposure)) ---

class ToneElement final : public WaveformElement {
 public:
  explicit ToneElement(const Tone& tone) : tone_(tone) {
    require_not_negative("frequency", tone.frequency);
    require_level("amplitude", tone.amplitude);
    require_finite("phase", tone.phase);
    require(tone.depth >= 0 && tone.depth <= 1, "depth", tone.depth, "from 0 to 1");
  }

  MeanLight mean_light(const Exposures& exposures) const override {
    const double half = tone_.amplitude / 2;
    const double swing = tone_.depth * sinc(cycles_of(tone_.frequency, exposures.exposure, "frequency").value());
    const CycleCounts in_mid_exposure(tone_.frequency, delayed(exposures, exposures.exposure / 2), turns(tone_.phase),
                                      "frequency");
    return [=](std::size_t first, double scale, const kernels::MeansOutput& to) {
      kernels::write_means(kernels::ToneMeans{scale * half, swing}, in_mid_exposure.from(first, to.means.size(), true),
                           to);
    };
  }

  double peak() const override { return std::abs(tone_.amplitude); }

  std::vector<Cosine> cosines() const override {
    const double half = tone_.amplitude / 2;
    return {{half, {}, {}}, {half * tone_.depth, {tone_.frequency, 0}, turns(tone_.phase)}};
  }

 private:
  Tone tone_;
};

// --- Square wave: each whole period adds the duty; the remainder of the exposure overlaps at most two pulses ---

class SquareElement final : public WaveformElement {
 public:
  explicit SquareElement(const SquareWave& wave) : wave_(wave) {
    require_not_negative("frequency", wave.frequency);
    require(wave.duty > 0 && wave.duty < 1, "duty", wave.duty, "above 0 and below 1");
    require_level("amplitude", wave.amplitude);
    require_finite("phase", wave.phase);
  }

  MeanLight mean_light(const Exposures& exposures) const override {
    const double duty = wave_.duty, amplitude = wave_.amplitude;
    const DoubleDouble length = cycles_of(wave_.frequency, exposures.exposure, "frequency");
    const double whole = std::floor(length.value());
    const DoubleDouble rest = length - DoubleDouble{whole, 0}, part = rest.high > 0 ? rest : DoubleDouble{};
    // counts the cycles at the middle of the remaining part, for a point at its end
    const CycleCounts counts(wave_.frequency, exposures, turns(wave_.phase) - part / 2, "frequency");
    if (is_point(length))
      return [=](std::size_t first, double scale, const kernels::MeansOutput& to) {
        for (std::size_t i = 0; i < to.means.size(); ++i) {
          const Position at = counts.at(first + i);
          const double further = at.fraction < 0 ? -at.rest : at.rest;
          to.put(i, duty / 2 - std::abs(at.fraction) - further > 0 ? scale * amplitude : 0);
        }
      };
    const DoubleDouble both = part + DoubleDouble{duty, 0};
    const kernels::SquareMeans means{amplitude,
                                     length.value(),
                                     whole * duty,
                                     both / 2,
                                     std::max((both - DoubleDouble{1, 0}).value(), 0.0),
                                     std::min(duty, part.value())};
    return [=](std::size_t first, double scale, const kernels::MeansOutput& to) {
      kernels::SquareMeans scaled = means;
      scaled.level *= scale;
      kernels::write_means(scaled, counts.from(first, to.means.size(), true), to);
    };
  }

  double peak() const override { return std::abs(wave_.amplitude); }

  std::vector<Step> steps(const Stretch& stretch) const override {
    const CycleCounter counter({wave_.frequency, 0}, stretch.line(), turns(wave_.phase));
    counter.require_countable(0, stretch.length, "frequency");
    const Position origin = counter.at(0.0);
    const double cycles = wave_.frequency * stretch.length;
    if (cycles < 1 / kMaxLevel) return {{{}, std::abs(origin.fraction) < wave_.duty / 2 ? wave_.amplitude : 0, 0}};
    const auto time_of = [&](double whole, double half_duty) {
      return (exact_sum(whole, half_duty) - DoubleDouble{origin.fraction, origin.rest}) / wave_.frequency;
    };
    std::vector<Step> steps;
    steps.reserve(static_cast<std::size_t>(max_steps(stretch.length)));
    for (double whole = -1; whole <= cycles + 1; ++whole) {
      steps.push_back({time_of(whole, -wave_.duty / 2), wave_.amplitude, 0});
      steps.push_back({time_of(whole, wave_.duty / 2), 0, 0});
    }
    return steps;
  }

  double max_steps(double length) const override { return 2 * wave_.frequency * length + 6; }

 private:
  SquareWave wave_;
};

// --- Chips and samples: cells of equal length, in each of which the light is a straight line, or a decay as well ---

double difference(DoubleDouble a, DoubleDouble b) { return (a.high - b.high) + (a.low - b.low); }

// Light of a cell above its straight line: height·exp(−u/time), u cells after its beginning.
struct Decay {
  double height = 0;
  double time = 1;  // cells

  double at(double u) const { return height == 0 ? 0 : height * std::exp(-u / time); }
  // Of `width` cells from u on.
  double integral(double u, double width) const { return height == 0 ? 0 : -at(u) * time * std::expm1(-width / time); }
};

struct Cells {
  // Light of all cells before each, in cells, and its value at its beginning, in turns; then that of all. The value of
  // the last cell comes first, and so does its slope below: kernels look one cell back.
  std::vector<double> chain{0, 0};
  std::vector<double> slopes{0};
  std::vector<double> before_low{0};  // (cells + 1) what the doubles of `chain` leave over
  std::vector<Decay> decays;          // one a cell, or none
  double left = 0;                    // before the first cell and after the last, where they do not repeat
  double right = 0;
  bool repeat = false;
  bool has_slopes = false, has_lows = false;

  std::int64_t count() const { return static_cast<std::int64_t>(slopes.size()) - 1; }

  void reserve(std::size_t count) {
    chain.reserve(2 * count + 2);
    for (auto* each : {&slopes, &before_low}) each->reserve(count + 1);
  }

  void append(double value, double slope) {
    const DoubleDouble after = total() + exact_sum(value, slope / 2);
    slopes.push_back(slope);
    slopes.front() = slope;
    has_slopes = has_slopes || slope != 0;
    chain.insert(chain.end(), {value, after.high});
    chain.front() = value;
    before_low.push_back(after.low);
    has_lows = has_lows || after.low != 0;
  }

  void append(double value, const Decay& decay) {
    append(value, 0);
    decays.push_back(decay);
    const DoubleDouble after = total() + DoubleDouble{decay.integral(0, 1), 0};
    chain.back() = after.high;
    before_low.back() = after.low;
  }

  DoubleDouble before(std::int64_t k) const {
    const auto at = static_cast<std::size_t>(std::min(k, count()));
    return {chain[2 * at + 1], before_low[at]};
  }
  DoubleDouble total() const { return {chain.back(), before_low.back()}; }

  // The cell of the first period that equals repeating cell k.
  std::int64_t inside_round(std::int64_t k) const {
    if (!repeat || (k >= 0 && k < count())) return k;
    const auto round = static_cast<std::int64_t>(static_cast<double>(k) / static_cast<double>(count()));  // or the next
    const std::int64_t remainder = k - round * count();
    if (remainder < 0) return remainder + count();
    return remainder < count() ? remainder : remainder - count();
  }

  // The line of light in cell k; for repeating cells -count <= k < count.
  std::pair<double, double> line(std::int64_t k) const {
    if (repeat && k < 0) k += count();
    if (k < 0) return {left, 0};
    if (k >= count()) return {right, 0};
    const auto at = static_cast<std::size_t>(k);
    return {chain[2 * at + 2], slopes[at + 1]};
  }

  Decay decay_of(std::int64_t k) const {
    if (repeat && k < 0) k += count();
    return decays.empty() || k < 0 || k >= count() ? Decay{} : decays[static_cast<std::size_t>(k)];
  }

  // Integral of the light over the cells first, …, last − 1.
  double light(std::int64_t first, std::int64_t last) const {
    if (first >= last) return 0;
    if (repeat) {
      if (first >= 0) return difference(before(last), before(first));
      return difference(total(), before(first + count())) + difference(before(last), before(0));
    }
    const auto inside = [&](std::int64_t k) { return std::clamp<std::int64_t>(k, 0, count()); };
    const auto on_left = std::max<std::int64_t>(0, std::min<std::int64_t>(last, 0) - first);
    const auto on_right = std::max<std::int64_t>(0, last - std::max(first, count()));
    return static_cast<double>(on_left) * left + static_cast<double>(on_right) * right +
           difference(before(inside(last)), before(inside(first)));
  }
};

class CellsLight {
 public:
  CellsLight(const Cells& cells, double amplitude, double rate, double start, const char* rate_name,
             const Exposures& exposures)
      : cells_(cells), amplitude_(amplitude), counts_(rate, delayed(exposures, start), {}, rate_name) {
    DoubleDouble length = cycles_of(rate, exposures.exposure, rate_name);
    point_ = is_point(length);
    length_ = length.value();
    if (cells.repeat) {
      const double rounds = std::floor(length_ / static_cast<double>(cells.count()));
      length = length - exact_product(rounds, static_cast<double>(cells.count()));
      whole_light_ = rounds * cells.total().value();
    }
    part_ = std::max(length.value(), 0.0);
    fits_tables_ = length_ > 1 / kMaxLevel && cells.decays.empty() && (cells.repeat || is_inside(exposures.instants));
  }

  void operator()(std::size_t first, double scale, const kernels::MeansOutput& to) const {
    if (fits_tables_) return kernels::write_means(means(scale), counts_.from(first, to.means.size(), false), to);
    for (std::size_t i = 0; i < to.means.size(); ++i) {
      const Position end = counts_.at(first + i);
      const double offset = end.fraction + end.rest;
      const bool below = end.fraction < 0 || (end.fraction == 0 && end.rest < 0);
      const auto cell = static_cast<std::int64_t>(end.whole) - (below ? 1 : 0);
      to.put(i, scale * amplitude_ * mean_before(cells_.inside_round(cell), below ? offset + 1 : offset));
    }
  }

 private:
  // True if the cells reach further than all exposures.
  bool is_inside(const Instants& instants) const {
    const CycleCounter& counter = counts_.counter();
    return counter.at(instants.first()).whole - length_ > 2 &&
           counter.at(instants.last()).whole + 1 < static_cast<double>(cells_.count());
  }

  kernels::CellMeans means(double scale) const {
    const double whole = std::floor(part_), origin = counts_.counter().origin_whole();
    return {cells_.chain.data() + 1,
            cells_.has_slopes ? cells_.slopes.data() + 1 : nullptr,
            cells_.has_lows ? cells_.before_low.data() : nullptr,
            cells_.count(),
            static_cast<std::int64_t>(std::fmod(origin, static_cast<double>(cells_.count()))),
            counts_.are_even(),
            counts_.per_exposure(),
            scale * amplitude_ / length_,
            static_cast<std::int64_t>(whole),
            part_ - whole,
            whole_light_};
  }

  // Mean light of the exposure that ends `offset` cells after the start of `cell`.
  double mean_before(std::int64_t cell, double offset) const {
    const auto decayed = [&](std::int64_t k, double u, double width) { return cells_.decay_of(k).integral(u, width); };
    const auto [value, slope] = cells_.line(cell);
    if (point_) return value + slope * offset + cells_.decay_of(cell).at(offset);
    if (offset >= part_) {
      const double level = value + slope * (offset - part_ / 2);
      const double more = whole_light_ + decayed(cell, offset - part_, part_);
      return more == 0 ? level * (part_ / length_) : (more + part_ * level) / length_;
    }
    const double left_over = part_ - offset;
    const auto between = static_cast<std::int64_t>(left_over);    // whole cells
    const double cut = left_over - static_cast<double>(between);  // of the cell in which the exposure begins
    const std::int64_t first = cell - 1 - between;
    const auto [first_value, first_slope] = cells_.line(first);
    const double ends = offset * (value + slope * offset / 2) + cut * (first_value + first_slope * (1 - cut / 2));
    const double above = decayed(cell, 0, offset) + decayed(first, 1 - cut, cut);
    return (whole_light_ + (ends + above + cells_.light(first + 1, cell))) / length_;
  }

  const Cells& cells_;
  double amplitude_;
  CycleCounts counts_;
  bool point_;
  double length_;           // of the exposure, in cells
  double part_;             // what is left of it after whole rounds of repeating cells
  double whole_light_ = 0;  // in those rounds
  bool fits_tables_ = false;
};

class CellsElement final : public WaveformElement {
 public:
  explicit CellsElement(const Chips& chips)
      : rate_(chips.chip_rate), start_(chips.start), amplitude_(chips.amplitude), rate_name_("chip_rate") {
    check("levels", chips.levels);
    require_level("amplitude", chips.amplitude);
    require_time_constant("rise", chips.rise);
    require_time_constant("fall", chips.fall);
    cells_.repeat = chips.repeat;
    cells_.reserve(chips.levels.size());
    if (chips.rise > 0 || chips.fall > 0)
      append_decays(chips);
    else
      for (double level : chips.levels) cells_.append(level, 0.0);
  }

  explicit CellsElement(const Samples& samples, const char* rate_name = "sample_rate")
      : rate_(samples.sample_rate), start_(samples.start), rate_name_(rate_name), has_slopes_(true) {
    const auto& values = samples.values;
    check("values", values);
    cells_.repeat = samples.repeat;
    cells_.left = values.front();
    cells_.right = values.back();
    cells_.reserve(values.size());
    for (std::size_t k = 0; k + 1 < values.size(); ++k) cells_.append(values[k], values[k + 1] - values[k]);
    if (samples.repeat) cells_.append(values.back(), values.front() - values.back());
  }

  MeanLight mean_light(const Exposures& exposures) const override {
    return CellsLight(cells_, amplitude_, rate_, start_, rate_name_, exposures);
  }

  double peak() const override { return peak_ * std::abs(amplitude_); }

  std::vector<Step> steps(const Stretch& stretch) const override {
    const CycleCounter counter({rate_, 0}, delayed(stretch.line(), start_), {});
    counter.require_countable(0, stretch.length, rate_name_);
    const Position origin = counter.at(0.0);
    const DoubleDouble part{origin.fraction, origin.rest};
    const auto first = static_cast<std::int64_t>(origin.whole) - (part < DoubleDouble{} ? 1 : 0);
    const auto after_last = static_cast<std::int64_t>(origin.whole + rate_ * stretch.length) + 2;
    std::vector<Step> steps;
    steps.reserve(static_cast<std::size_t>(max_steps(stretch.length)));
    const auto append = [&](std::int64_t cell) {
      const auto [value, slope] = cells_.line(cells_.inside_round(cell));
      const double past_origin = static_cast<double>(cell) - origin.whole;
      steps.push_back({(DoubleDouble{past_origin, 0} - part) / rate_, amplitude_ * value, amplitude_ * slope * rate_});
    };
    append(first);
    const std::int64_t next = cells_.repeat ? first + 1 : std::max<std::int64_t>(first + 1, 0);
    const std::int64_t last = cells_.repeat ? after_last : std::min(after_last, cells_.count() + 1);
    for (std::int64_t cell = next; cell < last; ++cell) append(cell);
    return steps;
  }

  double max_steps(double length) const override {
    const double passed = rate_ * length + 4;
    return cells_.repeat ? passed : std::min(passed, static_cast<double>(cells_.count()) + 4);
  }

  bool has_slopes() const override { return has_slopes_; }
  bool has_decays() const override { return !cells_.decays.empty(); }

 private:
  static void require_time_constant(const char* name, double time) {
    require(time >= 0 && time <= kMaxTimeConstant, name, time, "from 0 to 1000 chips");
  }

  // Repeated chips begin in the steady state, after as many rounds as a decay lasts; others end with it.
  void append_decays(const Chips& chips) {
    double light = 0;
    const auto decay_to = [&](double level) {
      const double time = light < level ? chips.rise : chips.fall;
      const Decay decay = time > 0 ? Decay{light - level, time} : Decay{};
      light = level + decay.at(1);
      return decay;
    };
    const double lasts = kDecayed * std::max(chips.rise, chips.fall);
    if (chips.repeat)
      for (double passed = 0; passed <= lasts; passed += static_cast<double>(chips.levels.size()))
        for (double level : chips.levels) decay_to(level);
    for (double level : chips.levels) cells_.append(level, decay_to(level));
    if (!chips.repeat)
      for (double passed = 0; passed <= lasts; ++passed) cells_.append(0.0, decay_to(0));
  }

  void check(const char* argument, const std::vector<double>& levels) {
    require(!levels.empty(), argument, "none", "at least one");
    for (double level : levels) {
      require_level(argument, level);
      peak_ = std::max(peak_, std::abs(level));
    }
    require_positive(rate_name_, rate_);
    require_finite("start", start_);
  }

  Cells cells_;
  double rate_;
  double start_;
  double amplitude_ = 1;
  const char* rate_name_;
  bool has_slopes_ = false;
  double peak_ = 0;
};

}  // namespace

DoubleDouble cycles_of(double rate, double exposure, const char* argument) {
  const DoubleDouble cycles = exact_product(rate, exposure);
  require(cycles.high < kMaxCycles, argument, rate, "at most 2^50 cycles or chips in an exposure");
  return cycles;
}

std::shared_ptr<const WaveformElement> make_element(const Tone& tone) { return std::make_shared<ToneElement>(tone); }
std::shared_ptr<const WaveformElement> make_element(const SquareWave& wave) {
  return std::make_shared<SquareElement>(wave);
}
// Two samples per period, the maximum and the minimum.
std::shared_ptr<const WaveformElement> make_element(const TriangleWave& wave) {
  require_not_negative("frequency", wave.frequency);
  require_level("amplitude", wave.amplitude);
  require_finite("phase", wave.phase);
  require(wave.depth >= 0 && wave.depth <= 1, "depth", wave.depth, "from 0 to 1");
  const double high = wave.amplitude / 2 * (1 + wave.depth);
  const double low = wave.amplitude / 2 * (1 - wave.depth);
  const double whole_turns = turns(wave.phase).value();
  const double fraction = whole_turns - std::round(whole_turns);
  if (wave.frequency < 1 / kMaxLevel) {
    const double level = high + 2 * std::abs(fraction) * (low - high);
    return std::make_shared<CellsElement>(Samples{{level}, 1});
  }
  const Samples samples{{high, low}, 2 * wave.frequency, -fraction / wave.frequency, true};
  return std::make_shared<CellsElement>(samples, "2 * frequency");
}
std::shared_ptr<const WaveformElement> make_element(const Chips& chips) {
  return std::make_shared<CellsElement>(chips);
}
std::shared_ptr<const WaveformElement> make_element(const Samples& samples) {
  return std::make_shared<CellsElement>(samples);
}

}  // namespace ocisac
