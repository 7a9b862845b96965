#include "ocisac/chips/sequence_detector.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>

#include "chips/sequence_kernels.hpp"
#include "core/aligned_memory.hpp"
#include "core/check_interrupt.hpp"
#include "ocisac/chips/chip_equations.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kMaxSlowMemory = 10;  // chips
constexpr std::size_t kMaxPatterns = 2 * 16;

// A row's exposure in chips, counted from the newest one: `end` of the newest, `begin` of the oldest, which is `back`
// chips older, and all chips between.
struct RowView {
  double value, scale;  // scale: 1/(2σ²)
  double end, begin;
  double length;
  std::size_t back, newest;
};

// A row whose oldest chip lies `back` chips before the newest depends only on the newest, the oldest and the number of
// bright chips between: costs by that number stand in a table for each newest and oldest chip.
constexpr std::size_t kTable = 32;  // a multiple of the number is read
struct Tables {
  std::size_t back;
  std::array<std::array<std::array<float, kTable>, 2>, 2> costs;
};

// Groups of states by the pattern of their costs: 2·(bright chips between that a group shares) + oldest chip.
class Grouping {
 public:
  Grouping(std::size_t back, std::size_t states) : back_(back), of_group_(states / kernels::kTrellisGroup) {
    if (back <= kLowBits) return;
    for (std::uint32_t g = 0; g < of_group_.size(); ++g)
      of_group_[g] = static_cast<std::uint8_t>(2 * std::popcount(g & ((1U << high_bits()) - 1U)) +
                                               static_cast<int>((g >> high_bits()) & 1U));
  }
  [[nodiscard]] const std::uint8_t* of_group() const { return of_group_.data(); }

  // The patterns of histories with a newest chip.
  void fill(const std::array<std::array<float, kTable>, 2>& tables, float* patterns) const {
    if (back_ > kLowBits)
      return kernels::fill_patterns({tables[0].data(), tables[1].data()}, high_bits() + 1, patterns);
    if (back_ == 0) return void(std::fill_n(patterns, kernels::kTrellisGroup, tables[0][0]));
    for (std::uint32_t low = 0; low < kernels::kTrellisGroup; ++low)
      patterns[low] =
          tables[(low >> (back_ - 1)) & 1U][static_cast<std::size_t>(kernels::kBits[low & ((1U << (back_ - 1)) - 1U)])];
  }

 private:
  static constexpr std::size_t kLowBits = std::bit_width(kernels::kTrellisGroup - 1);
  [[nodiscard]] std::size_t high_bits() const { return back_ - 1 - kLowBits; }  // of the chips between

  std::size_t back_;
  std::vector<std::uint8_t> of_group_;
};

// All chips, if the costs before each of them take 4 MB at most; else few, done twice.
std::size_t chips_in_block(std::size_t count, std::size_t states) {
  constexpr std::size_t kCached = std::size_t{1} << 20U;  // costs
  return count * states <= kCached ? count : static_cast<std::size_t>(std::ceil(std::sqrt(static_cast<double>(count))));
}

class Trellis {
 public:
  explicit Trellis(const ChipQuestion& question)
      : question_(question),
        length_(std::max(question.clock.exposure_rows, kShortestExposure) / question.clock.rows_per_chip),
        reach_(static_cast<std::size_t>(std::ceil((1 - kWholeChips) * length_))),
        memory_(memory_of(question.clock, reach_)),
        states_(std::max(std::size_t{1} << memory_, kernels::kFewestStates)),
        costs_(2 * states_),
        groupings_(memory_ + 1) {}

  std::vector<double> detect() {
    find_rows();
    fill_tables();
    if (is_slow()) find_lights();
    return run();
  }

 private:
  [[nodiscard]] bool is_slow() const { return question_.clock.rise > 0 || question_.clock.fall > 0; }

  // Earlier chips count until the light has settled to kUnsettled.
  static std::size_t memory_of(const ChipClock& clock, std::size_t reach) {
    const double settling = std::ceil(std::max(clock.rise, clock.fall) * std::log(1 / kUnsettled));
    const auto most = std::max(kMaxSlowMemory, reach);
    return std::min(reach + static_cast<std::size_t>(std::max(settling, 0.0)), most);
  }

  // Light of the chip `back` before the newest, of each history.
  struct ChipLight {
    std::vector<float> target, lack, sum;
    [[nodiscard]] kernels::ChipLights view() const { return {target.data(), lack.data(), sum.data()}; }
  };

  // For all histories, starting with the oldest chip, which begins at its own level.
  void find_lights() {
    const ChipClock& clock = question_.clock;
    const auto left_after_chip = [](double time) { return time > 0 ? std::exp(-1 / time) : 0.0; };
    const double left_of_rise = left_after_chip(clock.rise), left_of_fall = left_after_chip(clock.fall);
    const std::vector<float> zeros(2 * states_);
    lights_.assign(memory_ + 1, {zeros, zeros, zeros});
    for (std::size_t history = 0; history < 2 * states_; ++history) {
      const auto chip = [&](std::size_t back) {
        return static_cast<double>(back == 0 ? history / states_ : (history >> (back - 1)) & 1U);
      };
      double level = chip(memory_);
      for (std::size_t back = memory_ + 1; back-- > 0;) {
        const double target = chip(back);
        const bool rises = target > level;
        const double left = rises ? left_of_rise : left_of_fall;
        const double lack = (level - target) * (rises ? clock.rise : clock.fall);
        lights_[back].target[history] = static_cast<float>(target);
        lights_[back].lack[history] = static_cast<float>(lack);
        lights_[back].sum[history] = static_cast<float>(target + lack * (1 - left));
        level = target + (level - target) * left;
      }
      for (std::size_t back = 2; back <= memory_; ++back) lights_[back].sum[history] += lights_[back - 1].sum[history];
    }
  }

  // Settled fraction of a chip's step after `part` chips, by the kind of the chip.
  [[nodiscard]] std::array<float, 2> settled(double part) const {
    const auto share = [part](double time) { return time > 0 ? static_cast<float>(1 - std::exp(-part / time)) : 1.0F; };
    return {share(question_.clock.fall), share(question_.clock.rise)};
  }

  // Adds a row's squared residual over 2σ² to all histories.
  void add_slow_row(const RowView& row) {
    const double before = row.back == 0 ? row.end - row.length : 1 - row.begin;
    kernels::add_slow_row(
        {lights_.front().view(), lights_[row.back].view(), static_cast<float>(row.end), static_cast<float>(before),
         settled(row.end), settled(before), row.back == 0 ? 0.0F : 1.0F, static_cast<float>(row.value),
         static_cast<float>(1 / row.length), static_cast<float>(row.scale)},
        2 * states_, costs_.data());
  }

  // Groups rows by their newest chip: those of chip k are rows_[begin_of_chip_[k]] … rows_[begin_of_chip_[k + 1]].
  void find_rows() {
    const ChipClock& clock = question_.clock;
    begin_of_chip_.assign(question_.count + 1, 0);
    rows_.reserve(question_.rows.size());
    for (std::size_t n = 0; n < question_.rows.size(); ++n) {
      const auto row = static_cast<std::ptrdiff_t>(n);
      const double end = (clock.end_at(row) - clock.phase) / clock.rows_per_chip - static_cast<double>(question_.first);
      const double newest = std::clamp(std::floor(end), 0.0, static_cast<double>(question_.count - 1));
      const double length = length_ * clock.share_at(row), begin = end - newest - length;
      const double whole = std::min(std::floor(begin), 0.0), noise = question_.noise_of(n);
      const auto chip = static_cast<std::size_t>(newest);
      ++begin_of_chip_[chip + 1];
      rows_.push_back({question_.rows[n], 0.5 / (noise * noise), end - newest, 1 - (begin - whole), length,
                       std::min(static_cast<std::size_t>(-whole), reach_), chip});
    }
    for (std::size_t chip = 0; chip < question_.count; ++chip) begin_of_chip_[chip + 1] += begin_of_chip_[chip];
    if (clock.shorter < 1) std::ranges::stable_sort(rows_, {}, &RowView::newest);
  }

  // Squared residuals over 2σ², added up over the rows whose oldest chip lies `back` before the newest. In chips, a
  // row's light is the number m of bright chips between and a constant: the sum is a polynomial in m.
  void add_tables(std::span<const RowView> rows, std::size_t back) {
    double squares = 0, linear[2][2] = {}, constant[2][2] = {};  // of the newest and the oldest chip
    for (const RowView& row : rows) {
      if (row.back != back) continue;
      const double of_newest = back == 0 ? row.length : row.end, of_oldest = back == 0 ? 0 : row.begin;
      const double weight = row.scale / (row.length * row.length);
      squares += weight;
      for (std::size_t newest = 0; newest < 2; ++newest)
        for (std::size_t oldest = 0; oldest < 2; ++oldest) {
          const double at_ends = static_cast<double>(newest) * of_newest + static_cast<double>(oldest) * of_oldest;
          const double off = row.length * row.value - at_ends;
          linear[newest][oldest] += weight * off;
          constant[newest][oldest] += weight * off * off;
        }
    }
    Tables& tables = tables_.emplace_back(Tables{back, {}});
    const int counts = std::max(static_cast<int>(back), 1);
    for (std::size_t newest = 0; newest < 2; ++newest)
      for (std::size_t oldest = 0; oldest < (back == 0 ? 1 : 2); ++oldest) {
        const double at_none = constant[newest][oldest], slope = 2 * linear[newest][oldest];
        for (int m = 0; m < counts; ++m)
          tables.costs[newest][oldest][static_cast<std::size_t>(m)] =
              static_cast<float>(at_none - m * (slope - m * squares));
      }
  }

  void add_tables_of_known(double level) {
    Tables& tables = tables_.emplace_back(Tables{0, {}});
    for (std::size_t newest = 0; newest < 2; ++newest) {
      const double off = static_cast<double>(newest) - level;
      tables.costs[newest][0][0] = static_cast<float>(0.5 * kKnownPrecision * off * off);
    }
  }

  [[nodiscard]] std::span<const RowView> rows_of(std::size_t chip) const {
    return std::span(rows_).subspan(begin_of_chip_[chip], begin_of_chip_[chip + 1] - begin_of_chip_[chip]);
  }

  // Tables of all chips, which each pass over the trellis reads: of rows whose light has settled, and of known levels.
  void fill_tables() {
    tables_.reserve(question_.count);
    begin_of_tables_.assign(1, 0);
    for (std::size_t chip = 0; chip < question_.count; ++chip) {
      const auto rows = rows_of(chip);
      if (!is_slow() && !rows.empty()) {
        const auto [shortest, longest] = std::ranges::minmax_element(rows, {}, &RowView::back);
        for (std::size_t back = shortest->back; back <= longest->back; ++back) add_tables(rows, back);
      }
      if (const auto level = known_level(question_, chip)) add_tables_of_known(*level);
      begin_of_tables_.push_back(tables_.size());
    }
  }

  // Counts tables among the costs of a chip.
  void take_costs(const Tables& of) {
    if (grouped_.size() == kernels::kMostSummed) add_up_costs();
    auto& grouping = groupings_[of.back];
    if (!grouping) grouping.emplace(of.back, states_);
    auto& patterns = patterns_[grouped_.size()];
    for (std::size_t newest = 0; newest < 2; ++newest) grouping->fill(of.costs[newest], patterns[newest].data());
    grouped_.push_back({{patterns[0].data(), patterns[1].data()}, grouping->of_group()});
  }

  void add_up_costs() {
    for (const auto& each : grouped_) kernels::add_costs(each, states_, costs_.data());
    grouped_.clear();
    added_up_ = true;
  }

  // Costs of all histories at a chip, valid until the next call.
  kernels::HistoryCosts weigh(std::size_t chip) {
    if (added_up_) std::ranges::fill(costs_, 0.0F);
    grouped_.clear();
    added_up_ = is_slow();
    if (is_slow())
      for (const RowView& row : rows_of(chip)) add_slow_row(row);
    for (std::size_t k = begin_of_tables_[chip]; k < begin_of_tables_[chip + 1]; ++k) take_costs(tables_[k]);
    if (added_up_ || grouped_.empty()) add_up_costs();
    return {grouped_, costs_.data()};
  }

  // A check takes as long as a small trellis takes for a chip; a thousand states take a microsecond.
  void check_interrupt_at(std::size_t chip) const {
    constexpr std::size_t kStatesPerCheck = 1 << 16;
    if (chip % std::max<std::size_t>(kStatesPerCheck / states_, 1) == 0) check_interrupt();
  }

  // to[s]: min cost of the rows up to the chip, given the last chips s, from the same up to the previous chip, whose
  // least is taken off. Returns the least of `to`.
  float go_forward(std::size_t chip, const float* from, float lowest, float* to) {
    check_interrupt_at(chip);
    return kernels::step_forward(from, lowest, weigh(chip), states_, to);
  }

  // Costs before every chip of a block, kept at the first chips of all blocks alone: in the cache at all lengths.
  std::vector<double> run() {
    const std::size_t count = question_.count, block = chips_in_block(count, states_);
    const auto first_of = [&](std::size_t b) { return std::min(b * block, count); };
    const std::size_t blocks = (count + block - 1) / block;
    std::vector<float> starts(blocks * states_, 0.0F), lowest(blocks, 0.0F);
    thread_local AlignedMemory<float> kept;  // its pages are asked for once
    float* const costs = kept.at_least((block + 1) * states_);
    // Returns the least after its last chip.
    const auto fill_block = [&](std::size_t b) {
      std::copy_n(&starts[b * states_], states_, costs);
      float least = lowest[b];
      for (std::size_t chip = first_of(b); chip < first_of(b + 1); ++chip) {
        const float* from = &costs[(chip - first_of(b)) * states_];
        least = go_forward(chip, from, least, &costs[(chip - first_of(b) + 1) * states_]);
      }
      return least;
    };
    for (std::size_t b = 0; b + 1 < blocks; ++b) {
      lowest[b + 1] = fill_block(b);
      std::copy_n(&costs[block * states_], states_, &starts[(b + 1) * states_]);
    }
    std::vector<double> llr(count);
    AlignedMemory<float> two[2];
    float *after = two[0].at_least(states_), *before = two[1].at_least(states_);
    std::fill_n(after, states_, 0.0F);
    float lowest_after = 0;
    for (std::size_t b = blocks; b-- > 0;) {
      fill_block(b);
      for (std::size_t chip = first_of(b + 1); chip-- > first_of(b);) {
        check_interrupt_at(chip);
        const auto step = kernels::step_backward(&costs[(chip - first_of(b) + 1) * states_], weigh(chip), after,
                                                 lowest_after, states_, before);
        llr[chip] = static_cast<double>(step.best[0]) - static_cast<double>(step.best[1]);
        lowest_after = step.lowest;
        std::swap(after, before);
      }
    }
    return llr;
  }

  const ChipQuestion& question_;
  double length_;                        // of the exposure, chips
  std::size_t reach_, memory_, states_;  // earlier chips in a row's exposure; chips in memory
  std::vector<RowView> rows_;
  std::vector<Tables> tables_;  // of chip k from begin_of_tables_[k] on
  std::vector<std::size_t> begin_of_chip_, begin_of_tables_;
  std::vector<ChipLight> lights_;  // (chips of a history)
  // Costs of the histories at a chip: grouped ones, and the others added up, (2, states).
  std::vector<float> costs_;
  bool added_up_ = false;
  std::vector<kernels::GroupedCosts> grouped_;
  alignas(64) std::array<std::array<std::array<float, kMaxPatterns * kernels::kTrellisGroup>, 2>,
                         kernels::kMostSummed> patterns_;
  std::vector<std::optional<Grouping>> groupings_;  // (back) on demand
};

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
  return std::sqrt(rows_per_chip * mean_square_difference(exposure_rows / rows_per_chip));
}

}  // namespace ocisac
