#include <numbers>
#include <span>

#include "kernel_cases.hpp"
#include "light/waveform_kernels.hpp"

namespace kernel_cases {

namespace {

namespace kernels = ocisac::kernels;
using kernels::SquareMeans;
using kernels::ToneMeans;

constexpr double kStep = 0.0137 * 1.5, kOrigin = 0.0137 * 0.25 + 0.1, kGrid = 0x1p-32;

double cycles_at(double x) { return kOrigin + kStep * x; }

double on_grid(double cycles) { return std::round(cycles / kGrid) * kGrid; }

void count_plain(std::span<const double> x, double* coarse, double* fine) {
  for (std::size_t i = 0; i < x.size(); ++i) {
    coarse[i] = on_grid(kStep * x[i]);
    fine[i] = std::fma(kStep, x[i], -coarse[i]);
  }
}

// Exposures, and their counts of cycles by plain arithmetic.
class Exposures {
 public:
  explicit Exposures(std::vector<double> x)
      : x_(std::move(x)), coarse_(count() + kernels::kMaxReadAhead), fine_(coarse_.size()) {
    count_plain(x_, coarse_.data(), fine_.data());
  }

  [[nodiscard]] const std::vector<double>& x() const { return x_; }
  [[nodiscard]] std::size_t count() const { return x_.size(); }
  [[nodiscard]] kernels::Cycles cycles() const {
    return {coarse_.data(), fine_.data(), {on_grid(kOrigin), kOrigin - on_grid(kOrigin)}};
  }

 private:
  std::vector<double> x_, coarse_, fine_;
};

std::shared_ptr<Exposures> in_any_order(std::size_t count) {
  const auto rows = random_rows<double>(1, count, count, 0, 1000);
  return std::make_shared<Exposures>(std::vector(rows.data(), rows.data() + count));
}

std::shared_ptr<Exposures> evenly(std::size_t count, double first, double step) {
  std::vector<double> x(count);
  for (std::size_t i = 0; i < count; ++i) x[i] = first + step * static_cast<double>(i);
  return std::make_shared<Exposures>(std::move(x));
}

void add_plain(const ToneMeans& light, const std::vector<double>& x, double* out) {
  for (std::size_t i = 0; i < x.size(); ++i)
    out[i] += light.level * (1 + light.swing * std::cos(2 * std::numbers::pi * cycles_at(x[i])));
}

// Light of a square wave from cycle 0 on.
double light_until(double cycles, double half_duty) {
  const double since_rise = cycles + half_duty, whole = std::floor(since_rise);
  return whole * 2 * half_duty + std::min(since_rise - whole, 2 * half_duty);
}

void add_plain(const SquareMeans& light, const std::vector<double>& x, double* out) {
  const double part = light.length - std::floor(light.length), half_duty = light.reach.value() - part / 2;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double end = cycles_at(x[i]) + part / 2;
    out[i] += light.level * (light_until(end, half_duty) - light_until(end - light.length, half_duty)) / light.length;
  }
}

// Cells that repeat, with the light of all before each, as one number and, with the values in turns, as one or two.
struct Cells {
  std::vector<double> values, slopes, before{0}, low{0};
  // As the kernel reads them: after what belongs to the last cell.
  std::vector<double> chain{0, 0}, chain_slopes;

  Cells(std::size_t count, bool sloped, bool in_two) : slopes(count) {
    for (std::size_t k = 0; k < count; ++k) {
      values.push_back(static_cast<double>(k * 7 % 5) / 3);
      if (sloped) slopes[k] = static_cast<double>(k * 3 % 7) / 8 - 0.3;
      before.push_back(before.back() + values[k] + slopes[k] / 2);
      const double high = in_two ? static_cast<double>(static_cast<float>(before.back())) : before.back();
      chain.insert(chain.end(), {values[k], high});
      low.push_back(before.back() - high);
    }
    chain.front() = values.back();
    chain_slopes = slopes;
    chain_slopes.insert(chain_slopes.begin(), slopes.back());
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

KernelCase cells_case(const std::shared_ptr<Exposures>& exposures, bool even, double part, bool sloped, bool in_two) {
  const auto cells = std::make_shared<Cells>(11, sloped, in_two);
  const double rounds = 2, round_light = cells->before.back(), level = 0.7;
  const double scale = level / (part + rounds * 11), whole = std::floor(part);
  const std::size_t count = exposures->count();
  const auto run = [=](bool plain, double* out) {
    std::fill_n(out, count, 0.5);
    const std::vector<double>& x = exposures->x();
    if (!plain) {
      const double per_exposure = count > 1 ? kStep * (x[1] - x[0]) : 0;
      const kernels::CellMeans light{cells->chain.data() + 1,
                                     sloped ? cells->chain_slopes.data() + 1 : nullptr,
                                     in_two ? cells->low.data() : nullptr,
                                     11,
                                     0,
                                     even,
                                     per_exposure,
                                     scale,
                                     static_cast<int>(whole),
                                     part - whole,
                                     rounds * round_light};
      return kernels::write_means(light, exposures->cycles(), {{out, count}});
    }
    for (std::size_t i = 0; i < count; ++i) {
      const double end = cycles_at(x[i]);
      out[i] += scale * (cells->light_until(end) - cells->light_until(end - part) + rounds * round_light);
    }
  };
  return kernel_case<double>("write_means cells, " + std::to_string(count) + " exposures", 1e-11, {1, count, count},
                             run, count > 400);
}

template <class Means>
KernelCase means_case(const std::string& name, const Means& light, std::size_t count) {
  const auto exposures = in_any_order(count);
  const auto run = [=](bool plain, double* out) {
    std::fill_n(out, count, 0.5);
    if (plain) return add_plain(light, exposures->x(), out);
    kernels::write_means(light, exposures->cycles(), {{out, count}});
  };
  return kernel_case<double>("write_means " + name + ", " + std::to_string(count) + " exposures", 1e-12,
                             {1, count, count}, run, count > 400);
}

KernelCase counts_case(std::size_t count, bool fractions) {
  const auto rows = std::make_shared<Misaligned<double>>(random_rows<double>(1, count, count, 0, 1000));
  const auto run = [=](bool plain, double* out) {
    const std::span<const double> x(rows->data(), count);
    if (!plain) return kernels::count_cycles({kStep, 0}, kGrid, fractions, x, out, out + count);
    count_plain(x, out, out + count);
    for (std::size_t i = 0; fractions && i < count; ++i) out[i] -= std::round(kStep * x[i]);
  };
  const std::string name = fractions ? "count_cycles fractions, " : "count_cycles whole, ";
  return kernel_case<double>(name + std::to_string(count) + " exposures", 1e-15, {2, count, count}, run, count > 400);
}

void add_cases_of(std::size_t count, std::vector<KernelCase>& cases) {
  for (const bool fractions : {false, true}) cases.push_back(counts_case(count, fractions));
  cases.push_back(means_case("tone", ToneMeans{0.7, 0.8}, count));
  for (const auto& [duty, part] : {std::pair(0.3, 0.4), std::pair(0.9, 0.4), std::pair(0.3, 0.9), std::pair(0.8, 0.7)})
    cases.push_back(means_case(
        "square wave",
        SquareMeans{
            0.7, 2 + part, 2 * duty, {(duty + part) / 2, 0}, std::max(duty + part - 1, 0.0), std::min(duty, part)},
        count));
}

}  // namespace

std::vector<KernelCase> waveform_cases() {
  std::vector<KernelCase> cases;
  for (const double part : {0.3, 4.6, 10.9})
    for (const bool sloped : {false, true}) {
      for (const std::size_t count : kLengths) {
        cases.push_back(cells_case(evenly(count, 7, 1), true, part, sloped, false));
        cases.push_back(cells_case(in_any_order(count), false, part, sloped, false));
      }
      for (const double step : {0.0, 3.0, 1000.0})  // one exposure, some cells and some rounds after the other
        cases.push_back(cells_case(evenly(700, -300, step), true, part, sloped, part > 1));
      cases.push_back(cells_case(evenly(700, 300, -3), false, part, sloped, part > 1));
    }
  for (const std::size_t count : kLengths) add_cases_of(count, cases);
  add_cases_of(512, cases);
  return cases;
}

}  // namespace kernel_cases
