#include "ocisac/chips/reduced_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "core/check_interrupt.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

constexpr float kNever = std::numeric_limits<float>::infinity();
constexpr std::size_t kFirstExposures = 4;
constexpr std::uint32_t kNone = ~std::uint32_t{0};
constexpr double kSequencesPerRow = 2;  // kept ones that take as long as a row of a fit

// A kept sequence: its last chips (bit 0 the newest), and its one or two predecessors.
struct Kept {
  std::uint32_t state;
  float cost;  // nats above the best
  std::array<std::uint32_t, 2> from;
  std::array<float, 2> step;  // cost of its newest chip after either predecessor
};

// Contribution of the earlier chips to a chip's target, by tables of four chips each.
class Feedback {
 public:
  void set(const ChipEquations& equations, std::size_t chip) {
    const double* shares = equations.feedback(chip);
    const std::size_t reach = std::min(equations.band(), chip);
    tables_ = (equations.band() + 3) / 4;
    for (std::size_t t = 0; t < tables_; ++t) {
      auto& table = sums_[t];
      table[0] = t == 0 ? static_cast<float>(equations.target(chip)) : 0.0F;
      for (std::size_t bit = 0; bit < 4; ++bit) {
        const std::size_t back = 4 * t + bit + 1, words = std::size_t{1} << bit;
        const auto share = back <= reach ? static_cast<float>(shares[back]) : 0.0F;
        for (std::size_t word = 0; word < words; ++word) {
          table[word] += 0.5F * share;  // dark: x = −½
          table[word + words] = table[word] - share;
        }
      }
    }
  }
  [[nodiscard]] float mean(std::uint32_t state) const {
    float sum = 0;
    for (std::size_t t = 0; t < tables_; ++t, state >>= 4U) sum += sums_[t][state & 15U];
    return sum;
  }

 private:
  std::array<std::array<float, 16>, 8> sums_{};
  std::size_t tables_ = 0;
};

// Cost of sequences near the best one relative to it, with A the equations' matrix and g the gradient at the best
// sequence x. For inverted chips e = −2x there and 0 elsewhere: e·g + ½·eᵀAe nats.
class Neighbours {
 public:
  Neighbours(const ChipEquations& equations, std::span<const double> ratios)
      : equations_(equations), min_cost_(equations.count(), kNever) {
    for (const double ratio : ratios) chips_.push_back(ratio > 0 ? 0.5 : -0.5);
    find_gradient();
    const std::size_t band = equations_.band();
    for (std::size_t chip = 0; chip < chips_.size(); ++chip) {
      for (std::size_t count = 1; count <= kLongestRun; ++count) flip(chip, count, 0);
      for (const std::size_t apart : {band - 1, band})  // the ends of an exposure
        if (apart >= 2) flip(chip, 2, apart);
    }
  }
  [[nodiscard]] double min_cost(std::size_t chip) const { return min_cost_[chip]; }

 private:
  void find_gradient() {
    const std::size_t band = equations_.band();
    gradient_.assign(chips_.size(), 0.0);
    for (std::size_t chip = 0; chip < chips_.size(); ++chip) {
      const double* shares = equations_.feedback(chip);
      const std::size_t reach = std::min(band, chip);
      double off = chips_[chip] - equations_.target(chip);
      for (std::size_t back = 1; back <= reach; ++back) off += shares[back] * chips_[chip - back];
      off *= equations_.precision(chip);
      gradient_[chip] += off;
      for (std::size_t back = 1; back <= reach; ++back) gradient_[chip - back] += shares[back] * off;
    }
  }

  // A run of inverted chips; with `apart`, a second such run that begins this far after the first.
  void flip(std::size_t first, std::size_t count, std::size_t apart) {
    if (first + apart + count > chips_.size()) return;
    std::array<std::size_t, 2 * kLongestRun> flipped{};
    std::size_t size = 0;
    for (std::size_t k = 0; k < count; ++k) flipped[size++] = first + k;
    if (apart > 0)
      for (std::size_t k = 0; k < count; ++k) flipped[size++] = first + apart + k;
    double cost = 0;
    for (std::size_t i = 0; i < size; ++i) {
      cost += -2 * chips_[flipped[i]] * gradient_[flipped[i]] + 0.5 * equations_.normal(flipped[i], 0);
      for (std::size_t j = 0; j < i; ++j)
        cost += 4 * chips_[flipped[i]] * chips_[flipped[j]] * equations_.normal(flipped[i], flipped[i] - flipped[j]);
    }
    for (std::size_t i = 0; i < size; ++i) min_cost_[flipped[i]] = std::min(min_cost_[flipped[i]], std::max(cost, 0.0));
  }

  static constexpr std::size_t kLongestRun = 4;
  const ChipEquations& equations_;
  std::vector<double> chips_, gradient_, min_cost_;
};

class Search {
 public:
  Search(const ChipEquations& equations, const ReducedSearch& search)
      : equations_(equations), search_(search), mask_((std::uint32_t{1} << equations.band()) - 1) {}

  std::vector<double> run() {
    const std::vector<Kept> start{{0, 0.0F, {kNone, kNone}, {}}};
    begins_.push_back(0);
    for (std::size_t chip = 0; chip < equations_.count(); ++chip) {
      check_interrupt();
      extend(chip, chip == 0 ? std::span(start) : std::span(kept_).subspan(begins_[chip - 1]));
      begins_.push_back(kept_.size());
      if (search_.effort != nullptr &&
          !search_.effort->take(static_cast<double>(kept_at(chip).size()) / kSequencesPerRow))
        return std::vector<double>(equations_.count());
    }
    return look_back();
  }

 private:
  [[nodiscard]] std::span<const Kept> kept_at(std::size_t chip) const {
    return std::span(kept_).subspan(begins_[chip], begins_[chip + 1] - begins_[chip]);
  }

  // Extends each of `before`, in order of their states, by both chips. Sequences whose oldest chip is dark yield states
  // in order, and so do those with a bright one; the two lists are merged. Sequences that end in the same state are
  // joined, and the more likely one determines the cost.
  void extend(std::size_t chip, std::span<const Kept> before) {
    feedback_.set(equations_, chip);
    next_.clear();
    const auto half = static_cast<std::size_t>(
        std::ranges::partition_point(before, [&](const Kept& k) { return k.state <= mask_ / 2; }) - before.begin());
    const auto precision = static_cast<float>(equations_.precision(chip));
    std::size_t low = 0, high = half;
    while (low < half || high < before.size()) {
      const std::uint32_t of_low = low < half ? (before[low].state << 1U) & mask_ : kNone;
      const std::uint32_t of_high = high < before.size() ? (before[high].state << 1U) & mask_ : kNone;
      const std::uint32_t state = std::min(of_low, of_high);
      const std::size_t at = next_.size();
      next_.push_back({state, kNever, {kNone, kNone}, {}});
      next_.push_back({state | 1U, kNever, {kNone, kNone}, {}});
      const auto arrive = [&](std::size_t index, std::size_t slot) {
        const float mean = feedback_.mean(before[index].state);
        for (std::size_t bright = 0; bright < 2; ++bright) {
          const float off = (bright ? 0.5F : -0.5F) - mean;
          Kept& to = next_[at + bright];
          to.from[slot] = static_cast<std::uint32_t>(index);
          to.step[slot] = 0.5F * precision * off * off;
          to.cost = std::min(to.cost, before[index].cost + to.step[slot]);
        }
      };
      if (of_low == state) arrive(low++, 0);
      if (of_high == state) arrive(high++, 1);
    }
    const bool first = search_.effort == nullptr && chip < kFirstExposures * equations_.band();
    keep(first ? search_.max_first_sequences : search_.max_sequences);
  }

  // Keeps the most likely of next_, in order of their states.
  void keep(std::size_t max_count) {
    float lowest = kNever;
    for (const Kept& k : next_) lowest = std::min(lowest, k.cost);
    float limit = lowest + static_cast<float>(search_.reach);
    if (next_.size() > max_count) {
      costs_.clear();
      for (const Kept& k : next_) costs_.push_back(k.cost);
      const auto last = costs_.begin() + static_cast<std::ptrdiff_t>(max_count - 1);
      std::ranges::nth_element(costs_, last);
      limit = std::min(limit, *last);
    }
    // Ties at the limit (chips that no row covers) are kept only while there is room.
    auto room = static_cast<std::ptrdiff_t>(max_count) -
                std::ranges::count_if(next_, [&](const Kept& k) { return k.cost < limit; });
    for (Kept& k : next_) {
      if (k.cost > limit || (k.cost == limit && room-- <= 0)) continue;
      k.cost -= lowest;
      kept_.push_back(k);
    }
  }

  std::vector<double> look_back() {
    std::vector<double> ratios(equations_.count());
    std::vector<float> after(kept_at(equations_.count() - 1).size(), 0.0F), before;
    for (std::size_t chip = equations_.count(); chip-- > 0;) {
      check_interrupt();
      const auto kept = kept_at(chip), earlier = chip > 0 ? kept_at(chip - 1) : std::span<const Kept>{};
      std::array<float, 2> best{kNever, kNever};
      before.assign(earlier.size(), kNever);
      for (std::size_t k = 0; k < kept.size(); ++k) {
        float& lowest = best[kept[k].state & 1U];
        lowest = std::min(lowest, kept[k].cost + after[k]);
        for (std::size_t slot = 0; slot < 2; ++slot)
          if (kept[k].from[slot] < before.size())
            before[kept[k].from[slot]] = std::min(before[kept[k].from[slot]], kept[k].step[slot] + after[k]);
      }
      ratios[chip] = static_cast<double>(best[0]) - static_cast<double>(best[1]);  // infinite if one value was kept
      const float lowest = before.empty() ? 0.0F : *std::ranges::min_element(before);
      for (float& cost : before) cost -= lowest;
      after.swap(before);
    }
    estimate_unkept(ratios);
    return ratios;
  }

  void estimate_unkept(std::vector<double>& ratios) const {
    if (std::ranges::all_of(ratios, [](double value) { return std::isfinite(value); })) return;
    const Neighbours neighbours(equations_, ratios);
    for (std::size_t chip = 0; chip < ratios.size(); ++chip)
      if (!std::isfinite(ratios[chip])) ratios[chip] = std::copysign(neighbours.min_cost(chip), ratios[chip]);
  }

  const ChipEquations& equations_;
  const ReducedSearch search_;
  std::uint32_t mask_;
  Feedback feedback_;
  std::vector<Kept> kept_, next_;  // of all chips in sequence; candidates at a chip before the selection
  std::vector<std::size_t> begins_;
  std::vector<float> costs_;
};

}  // namespace

std::vector<double> search_reduced(const ChipEquations& equations, const ReducedSearch& search) {
  require(equations.band() <= static_cast<std::size_t>(kLongestReducedExposure), "exposure_chips", equations.band(),
          "at most 24 chips");
  require(search.max_sequences > 0, "max_sequences", search.max_sequences, "at least one sequence");
  require(search.max_first_sequences > 0, "max_first_sequences", search.max_first_sequences, "at least one sequence");
  require_positive("reach", search.reach);
  if (equations.count() == 0) return {};
  return Search(equations, search).run();
}

}  // namespace ocisac
