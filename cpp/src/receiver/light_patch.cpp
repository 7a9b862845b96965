#include "receiver/light_patch.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <numbers>
#include <type_traits>

#include "ocisac/camera/linear_light.hpp"
#include "receiver/refinement_kernels.hpp"

namespace ocisac {

namespace {

using Complex = std::complex<double>;

constexpr std::size_t most_groups = 64;  // of columns in a patch
constexpr std::size_t widest_sharp = 8;  // columns in a group of a small light

// Sums fit into 32 bits: a group of bytes or words is narrower than 2^16 columns.
template <class T>
using SumOf = std::conditional_t<std::is_integral_v<T>, std::uint32_t, double>;

template <class T>
void read_rows(const FramesView<const T>& view, std::size_t frame, double dark, Patch& patch) {
  const double share = 1 / static_cast<double>(patch.group);
  for (std::size_t n = 0; n < patch.rows; ++n) {
    const T* row = view.at(frame, patch.first_row + n, patch.first_column);
    for (std::size_t g = 0; g < patch.groups; ++g) {
      SumOf<T> sum = 0;
      for (std::size_t c = 0; c < patch.group; ++c)
        sum += row[static_cast<std::ptrdiff_t>(g * patch.group + c) * view.column_stride];
      patch.light[n * patch.stride + g] = static_cast<double>(sum) * share - dark;
    }
  }
}

// Columns lie in memory one after the other.
template <class T>
void read_columns(const FramesView<const T>& view, std::size_t frame, double dark, Patch& patch) {
  const double share = 1 / static_cast<double>(patch.group);
  std::vector<SumOf<T>> sums(patch.rows);
  for (std::size_t g = 0; g < patch.groups; ++g) {
    std::ranges::fill(sums, SumOf<T>{0});
    for (std::size_t c = 0; c < patch.group; ++c) {
      const T* column = view.at(frame, patch.first_row, patch.first_column + g * patch.group + c);
      for (std::size_t n = 0; n < patch.rows; ++n) sums[n] += column[static_cast<std::ptrdiff_t>(n) * view.row_stride];
    }
    for (std::size_t n = 0; n < patch.rows; ++n)
      patch.light[n * patch.stride + g] = static_cast<double>(sums[n]) * share - dark;
  }
}

std::vector<double> group_means(const Patch& patch, const std::vector<double>& values) {
  std::vector<double> means(patch.stride);
  for (std::size_t n = 0; n < patch.rows; ++n)
    for (std::size_t g = 0; g < patch.stride; ++g) means[g] += values[n * patch.stride + g];
  for (double& mean : means) mean /= static_cast<double>(patch.rows);
  return means;
}

kernels::Carrier view(const auto& rows) { return {rows.real.data(), rows.imaginary.data()}; }

}  // namespace

Box widened(const Box& box, std::size_t by) {
  const std::size_t left = std::min(box.column, by), up = std::min(box.row, by);
  return {box.column - left, box.row - up, box.width + left + by, box.height + up + by};
}

PatchRange Patch::range(const Box& box) const {
  const auto from = [](std::size_t a, std::size_t b) { return a - std::min(a, b); };
  PatchRange out{};
  out.first_row = std::min(from(box.row, first_row), rows);
  out.end_row = std::max(std::min(from(box.row + box.height, first_row), rows), out.first_row);
  out.first_group = std::min(from(box.column, first_column) / group, groups);
  const std::size_t last = (from(box.column + box.width, first_column) + group - 1) / group;
  out.end_group = std::max(std::min(last, groups), out.first_group);
  return out;
}

Patch patch_of(const AnyFramesView& frames, std::size_t frame, double dark, const Box& box, std::size_t margin,
               double floor) {
  const Shape shape = shape_of(frames);
  const std::size_t left = box.column - std::min(box.column, margin);
  const std::size_t right = std::min(shape.columns, box.column + box.width + margin);
  const std::size_t top = box.row - std::min(box.row, margin);
  const std::size_t bottom = std::min(shape.rows, box.row + box.height + margin);
  const std::size_t wanted = std::max<std::size_t>((right - left + most_groups - 1) / most_groups,
                                                   std::clamp<std::size_t>(box.width / 16, 1, widest_sharp));
  const std::size_t group = std::min(wanted, right - left);
  const std::size_t groups = (right - left) / group;
  const std::size_t stride = (groups + kernels::patch_padding - 1) / kernels::patch_padding * kernels::patch_padding;
  Patch patch{left, top, bottom - top, groups, group, stride, {}, {}};
  patch.light.resize(patch.rows * stride);
  patch.logs.resize(patch.rows * stride);
  std::visit(
      [&](const auto& view) {
        if (std::abs(view.row_stride) < std::abs(view.column_stride))
          read_columns(view, frame, dark, patch);
        else
          read_rows(view, frame, dark, patch);
      },
      frames);
  kernels::logarithms(patch.light.data(), patch.light.size(), floor, patch.logs.data());
  return patch;
}

Complex turned(double cycles) {
  const double angle = -2 * std::numbers::pi * (cycles - std::floor(cycles));
  return {std::cos(angle), std::sin(angle)};
}

std::size_t hann_length(double frequency) { return static_cast<std::size_t>(std::lround(1 / frequency)) * 2 + 1; }

// For the rows from `reach` before the first to `reach` after the last of `rows`.
Demodulator::Rows Demodulator::carrier(double frequency, std::size_t rows, std::size_t reach) {
  Rows out{std::vector<double>(rows + 2 * reach), std::vector<double>(rows + 2 * reach)};
  for (std::size_t i = 0; i < out.real.size(); ++i) {
    const Complex turn = turned(frequency * (static_cast<double>(i) - static_cast<double>(reach)));
    out.real[i] = turn.real(), out.imaginary[i] = turn.imag();
  }
  return out;
}

// One carrier times another, or with sign −1 its conjugate.
Demodulator::Rows Demodulator::product(const Rows& a, const Rows& b, double sign) {
  Rows out{std::vector<double>(a.real.size()), std::vector<double>(a.real.size())};
  for (std::size_t i = 0; i < out.real.size(); ++i) {
    out.real[i] = a.real[i] * b.real[i] - sign * a.imaginary[i] * b.imaginary[i];
    out.imaginary[i] = a.imaginary[i] * b.real[i] + sign * a.real[i] * b.imaginary[i];
  }
  return out;
}

Demodulator::Demodulator(double frequency, std::size_t rows)
    : length_(hann_length(frequency)),
      step_(carrier(1 / static_cast<double>(length_), rows, length_ / 2)),
      tone_(carrier(frequency, rows, length_ / 2)),
      below_(product(tone_, step_, -1)),
      above_(product(tone_, step_, 1)),
      turns_(carrier(1 / static_cast<double>(length_), rows, 0)) {}

SwingMap Demodulator::swing(const Patch& patch, const std::vector<double>& values) const {
  SwingMap map{std::vector<double>(values.size()), std::vector<double>(values.size())};
  const kernels::HannWindow window{view(below_), view(tone_), view(above_), view(turns_), length_};
  kernels::hann_demodulate({values.data(), patch.rows, patch.stride}, group_means(patch, values).data(), window,
                           map.real.data(), map.imaginary.data());
  return map;
}

std::vector<double> Demodulator::fast(const Patch& patch) const {
  const Rows still = product(step_, step_, -1), back = product(still, step_, -1);
  const kernels::HannWindow window{view(back), view(still), view(step_), view(turns_), length_};
  std::vector<double> slow(patch.logs.size()), unused(patch.logs.size());
  kernels::hann_demodulate({patch.logs.data(), patch.rows, patch.stride}, std::vector<double>(patch.stride).data(),
                           window, slow.data(), unused.data());
  std::ranges::transform(patch.logs, slow, slow.begin(), std::minus{});
  return slow;
}

}  // namespace ocisac
