#include "ocisac/chips/sequence_detector.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>

#include "core/check_interrupt.hpp"
#include "ocisac/chips/chip_equations.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kMaxSlowMemory = 10;  // chips
constexpr float kNever = std::numeric_limits<float>::infinity();
constexpr double kRounding = 1e-12;  // relative, of an exposure of a whole number of chips

// A row's exposure in chips, counted from the newest one: `end` of the newest, `begin` of the oldest, which is `back`
// chips older, and all chips between.
struct RowView {
  double value, scale;  // scale: 1/(2σ²)
  double end, begin;
  std::size_t back;
};

// A history is a word of the newest chip (bit 0) and earlier ones. A row whose oldest chip lies `back` chips before the
// newest depends only on the number of bright chips between, the newest and the oldest.
std::uint8_t class_of(std::uint32_t history, std::size_t back) {
  if (back == 0) return static_cast<std::uint8_t>(history & 1U);
  const std::uint32_t between = (history >> 1U) & ((1U << (back - 1)) - 1U);
  return static_cast<std::uint8_t>(4 * static_cast<unsigned>(std::popcount(between)) + 2 * (history & 1U) +
                                   ((history >> back) & 1U));
}

class Trellis {
 public:
  explicit Trellis(const ChipQuestion& question)
      : question_(question),
        length_(std::max(question.clock.exposure_rows, kShortestExposure) / question.clock.rows_per_chip),
        reach_(static_cast<std::size_t>(std::ceil((1 - kRounding) * length_))),
        memory_(memory_of(question.clock, reach_)),
        states_(std::size_t{1} << memory_),
        classes_(memory_ + 1) {}

  std::vector<double> detect() {
    find_rows();
    if (is_slow()) find_lights();
    run_forward();
    return run_backward();
  }

 private:
  [[nodiscard]] bool is_slow() const { return question_.clock.rise > 0 || question_.clock.fall > 0; }

  // Earlier chips count until the light has settled to kUnsettled.
  static std::size_t memory_of(const ChipClock& clock, std::size_t reach) {
    const double settling = std::ceil(std::max(clock.rise, clock.fall) * std::log(1 / kUnsettled));
    const auto most = std::max(kMaxSlowMemory, reach);
    return std::min(reach + static_cast<std::size_t>(std::max(settling, 0.0)), most);
  }

  // Light of a chip of a history: its target, the deviation of its integral from that of the settled light, and its
  // integral over the whole chip and all newer ones except the newest.
  struct ChipLight {
    float target, lack, sum;
  };

  // For all histories, starting with the oldest chip, which begins at its own level.
  void find_lights() {
    const ChipClock& clock = question_.clock;
    lights_.resize((memory_ + 1) * 2 * states_);
    for (std::size_t history = 0; history < 2 * states_; ++history) {
      double level = static_cast<double>((history >> memory_) & 1U);
      for (std::size_t back = memory_ + 1; back-- > 0;) {
        const double target = static_cast<double>((history >> back) & 1U);
        const double time = target > level ? clock.rise : clock.fall;
        const double left = time > 0 ? std::exp(-1 / time) : 0.0, lack = (level - target) * time;
        lights_[back * 2 * states_ + history] = {static_cast<float>(target), static_cast<float>(lack),
                                                 static_cast<float>(target + lack * (1 - left))};
        level = target + (level - target) * left;
      }
      for (std::size_t back = 2; back <= memory_; ++back)
        lights_[back * 2 * states_ + history].sum += lights_[(back - 1) * 2 * states_ + history].sum;
    }
  }

  // Settled fraction of a chip's step after `part` chips, by the kind of the chip.
  [[nodiscard]] std::array<float, 2> settled(double part) const {
    const auto share = [part](double time) { return time > 0 ? static_cast<float>(1 - std::exp(-part / time)) : 1.0F; };
    return {share(question_.clock.fall), share(question_.clock.rise)};
  }

  // Adds a row's squared residual over 2σ² to all histories.
  void add_slow_row(const RowView& row, std::span<float> costs) const {
    const ChipLight* newest = lights_.data();
    const ChipLight* oldest = &lights_[row.back * 2 * states_];
    const double before = row.back == 0 ? row.end - length_ : 1 - row.begin;
    const auto at_end = settled(row.end), at_begin = settled(before);
    const auto end = static_cast<float>(row.end), begin = static_cast<float>(before);
    const auto value = static_cast<float>(row.value), per_chip = static_cast<float>(1 / length_);
    const auto scale = static_cast<float>(row.scale);
    for (std::size_t history = 0; history < costs.size(); ++history) {
      const ChipLight& last = newest[history];
      const ChipLight& first = oldest[history];
      // Subtracts the part of the oldest chip before the exposure; newer chips count entirely.
      const float whole = row.back == 0 ? 0.0F : first.sum;
      const float last_share = at_end[0] + last.target * (at_end[1] - at_end[0]);
      const float first_share = at_begin[0] + first.target * (at_begin[1] - at_begin[0]);
      const float area =
          whole + last.target * end + last.lack * last_share - first.target * begin - first.lack * first_share;
      const float off = value - area * per_chip;
      costs[history] += scale * off * off;
    }
  }

  // Groups rows by their newest chip: those of chip k are rows_[begin_of_chip_[k]] … rows_[begin_of_chip_[k + 1]].
  void find_rows() {
    const ChipClock& clock = question_.clock;
    std::size_t chip = 0;
    begin_of_chip_.assign(question_.count + 1, 0);
    for (std::size_t row = 0; row < question_.rows.size(); ++row) {
      const double end = (static_cast<double>(row) + 0.5 * clock.exposure_rows - clock.phase) / clock.rows_per_chip -
                         static_cast<double>(question_.first);
      const double newest = std::clamp(std::floor(end), 0.0, static_cast<double>(question_.count - 1));
      for (; chip < static_cast<std::size_t>(newest); ++chip) begin_of_chip_[chip + 1] = rows_.size();
      const double begin = end - newest - length_;
      const double whole = std::min(std::floor(begin), 0.0);
      const double noise = question_.noise_of(row);
      rows_.push_back({question_.rows[row], 0.5 / (noise * noise), end - newest, 1 - (begin - whole),
                       std::min(static_cast<std::size_t>(-whole), reach_)});
    }
    for (; chip < question_.count; ++chip) begin_of_chip_[chip + 1] = rows_.size();
  }

  const std::vector<std::uint8_t>& classes(std::size_t back) {
    auto& of_history = classes_[back];
    for (std::uint32_t history = static_cast<std::uint32_t>(of_history.size()); history < 2 * states_; ++history)
      of_history.push_back(class_of(history, back));
    return of_history;
  }

  // Adds a row's squared residual over 2σ² to the classes of its `back`.
  void add_row(const RowView& row, std::span<float> table) const {
    if (row.back == 0) {
      for (std::size_t bright = 0; bright < 2; ++bright) table[bright] += squares(row, static_cast<double>(bright));
      return;
    }
    for (std::size_t between = 0; between < row.back; ++between)
      for (std::size_t ends = 0; ends < 4; ++ends) {
        const double area = static_cast<double>(between) + static_cast<double>(ends >> 1U) * row.end +
                            static_cast<double>(ends & 1U) * row.begin;
        table[4 * between + ends] += squares(row, area / length_);
      }
  }
  static float squares(const RowView& row, double expected) {
    return static_cast<float>(row.scale * (row.value - expected) * (row.value - expected));
  }

  // Costs of all histories at a chip.
  void weigh(std::size_t chip, std::vector<float>& costs) {
    std::fill(costs.begin(), costs.end(), 0.0F);
    if (is_slow())
      for (std::size_t r = begin_of_chip_[chip]; r < begin_of_chip_[chip + 1]; ++r) add_slow_row(rows_[r], costs);
    for (std::size_t back = 0; back <= memory_ && !is_slow(); ++back) {
      std::array<float, 4 * 16> table{};
      bool any = false;
      for (std::size_t r = begin_of_chip_[chip]; r < begin_of_chip_[chip + 1]; ++r) {
        if (rows_[r].back != back) continue;
        add_row(rows_[r], table);
        any = true;
      }
      if (!any) continue;
      const auto& of_history = classes(back);
      for (std::size_t history = 0; history < costs.size(); ++history) costs[history] += table[of_history[history]];
    }
    if (const auto level = known_level(question_, chip))
      for (std::size_t history = 0; history < costs.size(); ++history) {
        const double off = static_cast<double>(history & 1U) - *level;
        costs[history] += static_cast<float>(0.5 * kKnownPrecision * off * off);
      }
  }

  // forward_[chip·states + s]: min cost of the rows up to the previous chip, given the last chips s.
  void run_forward() {
    forward_.assign((question_.count + 1) * states_, 0.0F);
    std::vector<float> costs(2 * states_);
    const std::size_t half = states_ / 2;
    for (std::size_t chip = 0; chip < question_.count; ++chip) {
      check_interrupt();
      weigh(chip, costs);
      const float* from = &forward_[chip * states_];
      float* to = &forward_[(chip + 1) * states_];
      float lowest = kNever;
      for (std::size_t state = 0; state < states_; ++state) {
        // The chip that leaves the state is dark or bright.
        to[state] = std::min(from[state / 2] + costs[state], from[state / 2 + half] + costs[state + states_]);
        lowest = std::min(lowest, to[state]);
      }
      for (std::size_t state = 0; state < states_; ++state) to[state] -= lowest;  // preserves single precision
    }
  }

  std::vector<double> run_backward() {
    std::vector<double> llr(question_.count);
    std::vector<float> after(states_, 0.0F), before(states_), costs(2 * states_);
    for (std::size_t chip = question_.count; chip-- > 0;) {
      check_interrupt();
      weigh(chip, costs);
      for (std::size_t history = 0; history < costs.size(); ++history) costs[history] += after[history % states_];
      const float* from = &forward_[chip * states_];
      std::array<float, 2> best{kNever, kNever};
      for (std::size_t state = 0; state < states_; ++state) {
        const float dark = costs[2 * state], bright = costs[2 * state + 1];
        before[state] = std::min(dark, bright);
        best[0] = std::min(best[0], from[state] + dark);
        best[1] = std::min(best[1], from[state] + bright);
      }
      llr[chip] = static_cast<double>(best[0]) - static_cast<double>(best[1]);
      const float lowest = *std::ranges::min_element(before);
      for (std::size_t state = 0; state < states_; ++state) after[state] = before[state] - lowest;
    }
    return llr;
  }

  const ChipQuestion& question_;
  double length_;                                   // of the exposure, chips
  std::size_t reach_, memory_, states_;             // earlier chips in a row's exposure; chips in memory
  std::vector<std::vector<std::uint8_t>> classes_;  // (back) class of each history, computed on demand
  std::vector<RowView> rows_;
  std::vector<std::size_t> begin_of_chip_;
  std::vector<ChipLight> lights_;  // (chips of a history, histories)
  std::vector<float> forward_;
};

constexpr double kMaxSummedRows = 1 << 17;  // per chip: above, sums over rows equal integrals to 1e-10

// Mean square difference between the rows of 01 and 10, for exposures of `length` chips: the integral over chips of the
// squared difference, 2·(C(0) − C(length))/length², with C the autocorrelation of a triangle two chips wide (a cubic
// B-spline).
double mean_square_difference(double length) {
  if (length <= 1) return 2 - length;
  const double apart = length < 2 ? std::pow(2 - length, 3) / 6 : 0;
  return 2 * (2.0 / 3 - apart) / (length * length);
}

}  // namespace

std::vector<double> detect_sequence(const ChipQuestion& question) {
  check(question, kLongestDetectedExposure);
  if (question.count == 0) return {};
  return Trellis(question).detect();
}

double closest_pair_distance(double rows_per_chip, double exposure_rows) {
  require_positive("rows_per_chip", rows_per_chip);
  require_positive("exposure_rows", exposure_rows);
  constexpr int kPlaces = 16;  // positions of a chip relative to the rows
  const double length = exposure_rows / rows_per_chip;
  if (rows_per_chip > kMaxSummedRows) return std::sqrt(rows_per_chip * mean_square_difference(length));
  // Bright from 0 to 1, dark from 1 to 2, integrated up to a place.
  const auto area = [](double place) { return std::clamp(place, 0.0, 1.0) - std::clamp(place - 1, 0.0, 1.0); };
  // Rows differ while the chips enter or leave the exposure; between, the exposure contains both entirely.
  const double changing = std::floor(2 * rows_per_chip) + 2, all = std::floor(exposure_rows) + changing;
  double lowest = std::numeric_limits<double>::infinity();
  for (int place = 0; place < kPlaces; ++place) {
    double squares = 0;
    const auto add = [&](double from, double count) {
      for (int k = 0; k < static_cast<int>(count); ++k) {
        const double end = (from + k + static_cast<double>(place) / kPlaces) / rows_per_chip;
        const double off = (area(end) - area(end - length)) / length;
        squares += off * off;
      }
    };
    if (length > 2 + 2 / rows_per_chip) {
      add(0, changing);
      add(std::floor(exposure_rows), changing);
    } else {
      add(0, all);
    }
    lowest = std::min(lowest, squares);
  }
  return std::isfinite(length) ? std::sqrt(lowest) : 0.0;
}

}  // namespace ocisac
