#include "columns/equalizer_kernels.hpp"
#include "kernel_cases.hpp"

namespace kernel_cases {

namespace {

using ocisac::kernels::ColumnLines;

template <class T>
constexpr double kTolerance = std::is_same_v<T, float> ? 1e-4 : 1e-12;

template <class T>
std::string named(const std::string& kernel, const std::string& of) {
  return kernel + (std::is_same_v<T, float> ? " float " : " double ") + of;
}

std::string size_of(std::size_t rows, std::size_t width) { return std::to_string(rows) + "x" + std::to_string(width); }

// (3 × width) mean, slope, reach
template <class T>
void plain_lines(const T* block, std::size_t rows, std::size_t width, double* out) {
  const double middle = (static_cast<double>(rows) - 1) / 2;
  for (std::size_t c = 0; c < width; ++c) {
    double sum = 0, products = 0, squares = 0, reach = 0;
    for (std::size_t n = 0; n < rows; ++n) {
      const auto value = static_cast<double>(block[n * width + c]), from_middle = static_cast<double>(n) - middle;
      sum += value;
      products += from_middle * value;
      squares += from_middle * from_middle;
      reach = std::max(reach, std::abs(value - static_cast<double>(block[c])));
    }
    out[c] = sum / static_cast<double>(rows);
    out[width + c] = squares > 0 ? products / squares : 0;
    out[2 * width + c] = reach;
  }
}

template <class T>
KernelCase lines_case(std::size_t rows, std::size_t width) {
  auto block = std::make_shared<Misaligned<T>>(random_rows<T>(rows, width, width, 100, 5));
  const auto run = [=](bool plain, double* out) {
    if (plain) return plain_lines(block->data(), rows, width, out);
    ocisac::kernels::equalizer_loops<T>().column_lines(block->data(), rows, width, {out, out + width, out + 2 * width});
  };
  return kernel_case<double>(named<T>("column_lines", size_of(rows, width)), kTolerance<T>, {3, width, width}, run,
                             rows > 1000);
}

struct Lines {
  Misaligned<double> mean, slope, reach, scale;
};

// The line of some rows later.
template <class T>
KernelCase line_case(std::size_t rows, std::size_t width, double later) {
  auto block = std::make_shared<Misaligned<T>>(random_rows<T>(rows, width, width, 100, 5));
  auto lines =
      std::make_shared<Lines>(Lines{random_rows<double>(1, width, width), random_rows<double>(1, width, width),
                                    random_rows<double>(1, width, width), random_rows<double>(1, width, width)});
  const double middle = (static_cast<double>(rows) - 1) / 2;
  const auto run = [=](bool plain, T* out) {
    std::copy_n(block->data(), rows * width, out);
    const ColumnLines of{lines->mean.data(), lines->slope.data(), lines->reach.data()};
    if (!plain)
      return ocisac::kernels::equalizer_loops<T>().add_lines(out, rows, width, of, lines->scale.data(), later);
    for (std::size_t i = 0; i < rows * width; ++i) {
      const std::size_t c = i % width;
      const double row = static_cast<double>(i / width) - middle, value = static_cast<double>(out[i]);
      out[i] = static_cast<T>(value * lines->scale.data()[c] + of.mean[c] + of.slope[c] * (row + later));
    }
  };
  return kernel_case<T>(named<T>(later > 0 ? "add_lines later" : "add_lines", size_of(rows, width)), kTolerance<T>,
                        {1, rows * width, rows * width}, run, rows > 1000);
}

template <class T>
KernelCase product_case(std::size_t outputs, std::size_t inputs, std::size_t width, bool forwards = false) {
  auto matrix = std::make_shared<Misaligned<T>>(random_rows<T>(outputs, inputs, inputs));
  auto rows = std::make_shared<Misaligned<T>>(random_rows<T>(inputs, width, width));
  const auto run = [=](bool plain, T* out) {  // or from the last row to the first
    const T* const first = rows->data() + (forwards ? 0 : (inputs - 1) * width);
    const auto stride = static_cast<std::ptrdiff_t>(width);
    if (!plain)
      return ocisac::kernels::equalizer_loops<T>().matrix_times_rows(matrix->data(), outputs, inputs, first,
                                                                     forwards ? stride : -stride, out, stride, width);
    for (std::size_t i = 0; i < outputs; ++i)
      for (std::size_t c = 0; c < width; ++c) {
        double sum = 0;
        for (std::size_t j = 0; j < inputs; ++j)
          sum += static_cast<double>(matrix->data()[i * inputs + j]) *
                 static_cast<double>(rows->data()[(forwards ? j : inputs - 1 - j) * width + c]);
        out[i * width + c] = static_cast<T>(sum);
      }
  };
  return kernel_case<T>(named<T>(forwards ? "matrix_times_rows forwards" : "matrix_times_rows",
                                 size_of(outputs, inputs) + "x" + std::to_string(width)),
                        kTolerance<T>, {1, outputs * width, outputs * width}, run, outputs > 50);
}

template <class T>
void add_cases_of(std::vector<KernelCase>& cases) {
  for (const std::size_t width : {16u, 32u, 48u}) {
    for (const std::size_t rows : {1u, 2u, 17u, 70u, 1080u}) {
      cases.push_back(lines_case<T>(rows, width));
      cases.push_back(line_case<T>(rows, width, 0));
      cases.push_back(line_case<T>(rows, width, 3.25));
    }
    for (const std::size_t outputs : {1u, 2u, 3u, 4u, 9u})
      for (const bool forwards : {false, true}) cases.push_back(product_case<T>(outputs, 7, width, forwards));
  }
  cases.push_back(product_case<T>(70, 233, 32));
}

}  // namespace

std::vector<KernelCase> equalizer_cases() {
  std::vector<KernelCase> cases;
  add_cases_of<float>(cases);
  add_cases_of<double>(cases);
  return cases;
}

}  // namespace kernel_cases
