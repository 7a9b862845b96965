#include <bit>

#include "chips/sequence_kernels.hpp"
#include "kernel_cases.hpp"

namespace kernel_cases {

namespace {

using ocisac::kernels::ChipLights;
using ocisac::kernels::GroupedCosts;
using ocisac::kernels::HistoryCosts;
using ocisac::kernels::kTrellisGroup;
using ocisac::kernels::SlowRow;

constexpr std::size_t kPatterns = 5;

// Random costs of a trellis: of groups, and of all histories.
struct Trellis {
  std::size_t states;
  Misaligned<float> patterns, all, from, after;
  std::vector<std::uint8_t> of_group;

  explicit Trellis(std::size_t count)
      : states(count),
        patterns(random_rows<float>(1, 2 * kPatterns * kTrellisGroup, 2 * kPatterns * kTrellisGroup)),
        all(random_rows<float>(1, 2 * count, 2 * count)),
        from(random_rows<float>(1, count, count)),
        after(random_rows<float>(1, count, count)) {
    for (std::size_t g = 0; g < count / kTrellisGroup; ++g)
      of_group.push_back(static_cast<std::uint8_t>((g * 7 + 3) % kPatterns));
  }
  [[nodiscard]] std::vector<GroupedCosts> grouped(std::size_t summed) const {
    const float* dark = patterns.data();
    return std::vector<GroupedCosts>(summed, GroupedCosts{{dark, dark + kPatterns * kTrellisGroup}, of_group.data()});
  }
  [[nodiscard]] float cost(std::size_t summed, std::size_t newest, std::size_t state) const {
    if (summed == 0) return all.data()[newest * states + state];
    const std::size_t pattern = newest * kPatterns + of_group[state / kTrellisGroup];
    return static_cast<float>(summed) * patterns.data()[pattern * kTrellisGroup + state % kTrellisGroup];
  }
};

constexpr float kLess = 0.625F;

// Takes kLess off; returns the least.
float take_off(float* values, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) values[i] -= kLess;
  return *std::min_element(values, values + count);
}

// to, then its least.
void plain_forward(const Trellis& trellis, std::size_t summed, float* to) {
  std::fill_n(to, trellis.states, std::numeric_limits<float>::infinity());
  for (std::size_t state = 0; state < trellis.states; ++state)
    for (std::size_t newest = 0; newest < 2; ++newest) {
      float& best = to[(2 * state + newest) % trellis.states];
      best = std::min(best, trellis.from.data()[state] + trellis.cost(summed, newest, state));
    }
  to[trellis.states] = take_off(to, trellis.states);
}

// before, then the best of states whose newest chip is dark and is bright, and the least of before. `from` stands for
// the costs until the chip.
void plain_backward(const Trellis& trellis, std::size_t summed, float* out) {
  std::fill_n(out, trellis.states + 2, std::numeric_limits<float>::infinity());
  for (std::size_t state = 0; state < trellis.states; ++state) {
    float& best = out[trellis.states + state % 2];
    best = std::min(best, trellis.from.data()[state] + trellis.after.data()[state]);
    for (std::size_t newest = 0; newest < 2; ++newest)
      out[state] = std::min(out[state], trellis.cost(summed, newest, state) +
                                            trellis.after.data()[(2 * state + newest) % trellis.states]);
  }
  out[trellis.states + 2] = take_off(out, trellis.states);
}

template <class Run>
void add_case(const std::string& name, std::size_t values, std::size_t states, Run run,
              std::vector<KernelCase>& cases) {
  cases.push_back(kernel_case<float>(name + ", " + std::to_string(states) + " states", 1e-6, {1, values, values}, run,
                                     states > 100));
}

void add_cases_of(std::size_t states, std::vector<KernelCase>& cases) {
  const auto trellis = std::make_shared<Trellis>(states);
  for (std::size_t summed = 0; summed <= ocisac::kernels::kMostSummed; ++summed) {
    const std::string name = " of " + std::to_string(summed) + " grouped costs";
    add_case(
        "step_forward" + name, states + 1, states,
        [=](bool plain, float* out) {
          if (plain) return plain_forward(*trellis, summed, out);
          const auto grouped = trellis->grouped(summed);
          out[states] =
              ocisac::kernels::step_forward(trellis->from.data(), kLess, {grouped, trellis->all.data()}, states, out);
        },
        cases);
    add_case(
        "step_backward" + name, states + 3, states,
        [=](bool plain, float* out) {
          if (plain) return plain_backward(*trellis, summed, out);
          const auto grouped = trellis->grouped(summed);
          const auto step = ocisac::kernels::step_backward(trellis->from.data(), {grouped, trellis->all.data()},
                                                           trellis->after.data(), kLess, states, out);
          std::ranges::copy(step.best, out + states);
          out[states + 2] = step.lowest;
        },
        cases);
  }
  add_case(
      "add_costs", 2 * states, states,
      [=](bool plain, float* out) {
        std::copy_n(trellis->all.data(), 2 * states, out);
        if (!plain) return ocisac::kernels::add_costs(trellis->grouped(1)[0], states, out);
        for (std::size_t h = 0; h < 2 * states; ++h) out[h] += trellis->cost(1, h / states, h % states);
      },
      cases);
}

void add_pattern_case(std::size_t counts, std::vector<KernelCase>& cases) {
  const std::size_t values = 2 * counts * kTrellisGroup, length = counts + kTrellisGroup;
  const auto tables = std::make_shared<Misaligned<float>>(random_rows<float>(2, length, length));
  const auto run = [=](bool plain, float* out) {
    const std::array<const float*, 2> of{tables->data(), tables->data() + length};
    if (!plain) return ocisac::kernels::fill_patterns(of, counts, out);
    for (std::size_t k = 0; k < values; ++k)
      out[k] = of[k / kTrellisGroup % 2]
                 [k / (2 * kTrellisGroup) + static_cast<std::size_t>(std::popcount(k % kTrellisGroup))];
  };
  cases.push_back(kernel_case<float>("fill_patterns of " + std::to_string(counts) + " counts", 0, {1, values, values},
                                     run, counts > 5));
}

// The row of a history: the whole of the chips between, and the parts of the newest and of the oldest.
void add_slow_case(std::size_t histories, std::vector<KernelCase>& cases) {
  const auto lights = std::make_shared<Misaligned<float>>(random_rows<float>(6, histories, histories));
  const auto row = [=] {
    const float* values = lights->data();
    const auto at = [&](std::size_t k) { return values + k * histories; };
    return SlowRow{
        {at(0), at(1), at(2)}, {at(3), at(4), at(5)}, 0.3F, 0.6F, {0.2F, 0.5F}, {0.7F, 0.4F}, 1.0F, 1.4F, 0.25F, 3.0F};
  };
  const auto run = [=](bool plain, float* out) {
    std::fill_n(out, histories, 0.5F);
    const SlowRow r = row();
    if (!plain) return ocisac::kernels::add_slow_row(r, histories, out);
    for (std::size_t h = 0; h < histories; ++h) {
      const auto share = [](const std::array<float, 2>& of, float target) {
        return (1 - target) * of[0] + target * of[1];
      };
      const float newest = r.newest.target[h], oldest = r.oldest.target[h];
      const float light = r.oldest.sum[h] + newest * r.end + r.newest.lack[h] * share(r.at_end, newest) -
                          oldest * r.begin - r.oldest.lack[h] * share(r.at_begin, oldest);
      out[h] += r.scale * (r.value - r.per_chip * light) * (r.value - r.per_chip * light);
    }
  };
  add_case("add_slow_row", histories, histories, run, cases);
}

}  // namespace

std::vector<KernelCase> sequence_cases() {
  std::vector<KernelCase> cases;
  for (const std::size_t states : {std::size_t{32}, std::size_t{64}, std::size_t{512}}) {
    add_cases_of(states, cases);
    add_slow_case(2 * states, cases);
  }
  for (const std::size_t counts : {1, 2, 11}) add_pattern_case(counts, cases);
  return cases;
}

}  // namespace kernel_cases
