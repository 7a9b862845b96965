#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <cstdint>

#include "receiver/colour_streams.hpp"

namespace ocisac {

namespace {

// Bits of −1 and 1 of stream `stream`, a linear congruential sequence for each.
std::vector<double> bits(std::size_t stream, std::size_t count = 120) {
  std::vector<double> result;
  std::uint32_t state = 12345 + 7919 * static_cast<std::uint32_t>(stream);
  for (std::size_t k = 0; k < count; ++k) {
    state = 1664525 * state + 1013904223;
    result.push_back((state >> 24) % 2 == 0 ? -1 : 1);
  }
  return result;
}

using Values = std::vector<std::vector<double>>;

Values mixed(const std::vector<std::array<double, 3>>& mixing, const std::vector<std::vector<double>>& streams) {
  Values values;
  for (const auto& gains : mixing) {
    std::vector<double> line(streams.front().size(), 100);
    for (std::size_t j = 0; j < streams.size(); ++j)
      for (std::size_t k = 0; k < line.size(); ++k)
        line[k] += gains[j] * streams[j][k] + 0.01 * std::sin(static_cast<double>(k * k));
    values.push_back(line);
  }
  return values;
}

double response(const ColourStream& stream, const std::vector<std::array<double, 3>>& mixing, std::size_t of) {
  double sum = 0;
  for (std::size_t c = 0; c < mixing.size(); ++c) sum += stream.weights[c] * mixing[c][of];
  return sum;
}

}  // namespace

TEST_CASE("three mixed streams are separated, each scaled as the colour that shows it") {
  const std::vector<std::array<double, 3>> mixing{{10, 4, 2}, {3, 9, 4}, {1, 5, 12}};
  const auto found = colour_streams(mixed(mixing, {bits(0), bits(1), bits(2)}));
  REQUIRE(found.size() == 3);
  std::array<bool, 3> seen{};
  for (const auto& stream : found) {
    seen.at(stream.colour) = true;
    for (std::size_t j = 0; j < 3; ++j)
      CHECK(response(stream, mixing, j) ==
            doctest::Approx(j == stream.colour ? mixing[j][j] : 0).scale(10).epsilon(0.01));
  }
  CHECK(seen == std::array<bool, 3>{true, true, true});
}

TEST_CASE("a small opposite swing is the camera's correction of colours") {
  const auto found = colour_streams(mixed({{10, 0, 0}, {-1, 0, 0}, {8, 0, 0}}, {bits(6), bits(7), bits(8)}));
  CHECK(found.size() == 1);
}

TEST_CASE("steady colours, single ones and short frames have no streams") {
  CHECK(colour_streams({std::vector<double>(50, 1), std::vector<double>(50, 2)}).empty());
  CHECK(colour_streams({bits(0)}).empty());
  CHECK(colour_streams({bits(0, 7), bits(1, 7)}).empty());
}

}  // namespace ocisac
