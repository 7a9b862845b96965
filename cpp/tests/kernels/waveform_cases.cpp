#include <numbers>

#include "kernel_cases.hpp"
#include "light/waveform_kernels.hpp"

namespace kernel_cases {

namespace {

using ocisac::CycleCounter;
using ocisac::kernels::SquareMeans;
using ocisac::kernels::ToneMeans;

CycleCounter counter() { return {{0.0137, 0}, {{0.25, 0}, 1.5}, {0.1, 0}}; }

double cycles_at(double x) { return 0.0137 * (0.25 + 1.5 * x) + 0.1; }

void add_plain(const ToneMeans& light, const double* x, std::size_t count, double* out) {
  for (std::size_t i = 0; i < count; ++i)
    out[i] += light.level * (1 + light.swing * std::cos(2 * std::numbers::pi * cycles_at(x[i])));
}

// Light of a square wave from cycle 0 on.
double light_until(double cycles, double half_duty) {
  const double since_rise = cycles + half_duty, whole = std::floor(since_rise);
  return whole * 2 * half_duty + std::min(since_rise - whole, 2 * half_duty);
}

void add_plain(const SquareMeans& light, const double* x, std::size_t count, double* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const double end = cycles_at(x[i]);
    out[i] += light.level * (light_until(end, light.half_duty) - light_until(end - light.length, light.half_duty)) /
              light.length;
  }
}

// Cells that repeat, with the light of all before each, as one number and, with the values in turns, as one or two.
struct Cells {
  std::vector<double> values, slopes, before{0}, chain{0}, low{0};

  Cells(std::size_t count, bool sloped, bool in_two) : slopes(count) {
    for (std::size_t k = 0; k < count; ++k) {
      values.push_back(static_cast<double>(k * 7 % 5) / 3);
      if (sloped) slopes[k] = static_cast<double>(k * 3 % 7) / 8 - 0.3;
      before.push_back(before.back() + values[k] + slopes[k] / 2);
      const double high = in_two ? static_cast<double>(static_cast<float>(before.back())) : before.back();
      chain.insert(chain.end(), {values[k], high});
      low.push_back(before.back() - high);
    }
  }
  // From cell 0 on.
  [[nodiscard]] double light_until(double cells) const {
    const auto count = static_cast<double>(values.size());
    const double rounds = std::floor(cells / count), whole = std::floor(cells - rounds * count);
    const auto k = static_cast<std::size_t>(whole);
    const double u = cells - rounds * count - whole;
    return rounds * before.back() + before[k] + u * (values[k] + slopes[k] * u / 2);
  }
};

KernelCase cells_case(std::size_t count, double part, bool sloped, bool in_two) {
  const auto cells = std::make_shared<Cells>(11, sloped, in_two);
  auto x = std::make_shared<Misaligned<double>>(random_rows<double>(1, count, count, 0, 1000));
  const double rounds = 2, round_light = cells->before.back();
  const double length = part + rounds * 11, level = 0.7;
  const auto run = [=](bool plain, double* out) {
    std::fill_n(out, count, 0.5);
    if (!plain) {
      const ocisac::kernels::CellTables tables{cells->chain.data(), sloped ? cells->slopes.data() : nullptr,
                                               in_two ? cells->low.data() : nullptr, 11};
      const ocisac::kernels::CellMeans light{counter(), tables, level, length, part, rounds * round_light};
      return ocisac::kernels::add_means(light, x->data(), count, out);
    }
    for (std::size_t i = 0; i < count; ++i) {
      const double end = cycles_at(x->data()[i]);
      const double of_part = cells->light_until(end) - cells->light_until(end - part);
      out[i] += level * (of_part + rounds * round_light) / length;
    }
  };
  return kernel_case<double>("add_means cells, " + std::to_string(count) + " exposures", 1e-11, {1, count, count}, run,
                             count > 400);
}

template <class Means>
KernelCase means_case(const std::string& name, const Means& light, std::size_t count) {
  auto x = std::make_shared<Misaligned<double>>(random_rows<double>(1, count, count, 0, 1000));
  const auto run = [=](bool plain, double* out) {
    std::fill_n(out, count, 0.5);
    if (plain) return add_plain(light, x->data(), count, out);
    ocisac::kernels::add_means(light, x->data(), count, out);
  };
  return kernel_case<double>("add_means " + name + ", " + std::to_string(count) + " exposures", 1e-12,
                             {1, count, count}, run, count > 400);
}

void add_cases_of(std::size_t count, std::vector<KernelCase>& cases) {
  cases.push_back(means_case("tone", ToneMeans{counter(), 0.7, 0.8}, count));
  const double duty = 0.3, whole = 2;
  cases.push_back(
      means_case("square wave", SquareMeans{counter(), 0.7, duty / 2, whole + 0.4, 0.4, whole * duty}, count));
}

}  // namespace

std::vector<KernelCase> waveform_cases() {
  std::vector<KernelCase> cases;
  for (const double part : {0.3, 4.6, 10.9})
    for (const bool sloped : {false, true}) {
      for (const std::size_t count : kLengths) cases.push_back(cells_case(count, part, sloped, false));
      cases.push_back(cells_case(512, part, sloped, part > 1));
    }
  for (const std::size_t count : kLengths) add_cases_of(count, cases);
  add_cases_of(512, cases);
  return cases;
}

}  // namespace kernel_cases
