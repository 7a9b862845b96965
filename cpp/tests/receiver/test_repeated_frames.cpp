// Frames that were given twice, among frames of random chips.
#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <random>
#include <span>
#include <vector>

#include "receiver/rows_of_noise.hpp"

namespace {

constexpr std::size_t kRows = 600, kFrames = 10;

// Chips of `chip` rows, each row a mean over `exposure` rows, on a spot; the frame begins at row `start` of the chips.
std::vector<double> frame_of(const std::vector<double>& chips, double start, double chip, double exposure,
                             double spot) {
  std::vector<double> rows(kRows);
  for (std::size_t n = 0; n < kRows; ++n) {
    double light = 0;
    for (int part = 0; part < 16; ++part) {
      const double row = start + static_cast<double>(n) - exposure * (part + 0.5) / 16 + 100;
      light += chips[static_cast<std::size_t>(row / chip) % chips.size()] / 16;
    }
    rows[n] = 20 + 100 * light * std::exp(-0.5 * std::pow((static_cast<double>(n) - 300) / spot, 2));
  }
  return rows;
}

std::vector<std::uint8_t> repeated(const std::vector<std::vector<double>>& frames) {
  const std::vector<std::span<const double>> rows(frames.begin(), frames.end());
  return ocisac::repeated_frames(rows);
}

void add_noise(std::vector<double>& rows, double noise, std::mt19937& random) {
  std::normal_distribution<double> normal(0, noise);
  for (double& row : rows) row += normal(random);
}

}  // namespace

TEST_CASE("frames given twice are found, others are not") {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<double> chips(1000);
  for (int draw = 0; draw < 100; ++draw) {
    for (double& level : chips) level = uniform(random) < 0.5 ? 0 : 1;
    const double chip = 2 + 8 * uniform(random), exposure = chip * (0.5 + 5 * uniform(random));
    const double spot = 120 + 400 * uniform(random), noise = 0.2 + 2 * uniform(random);
    const bool coded = uniform(random) < 0.5;  // a video codec gives the frame again with noise of its own
    std::vector<std::vector<double>> frames;
    std::vector<std::uint8_t> expected;
    while (frames.size() < kFrames) {
      const bool again = frames.size() > 1 && expected.back() == 0 && uniform(random) < 0.25;
      frames.push_back(again ? frames.back()
                             : frame_of(chips, 997 * static_cast<double>(frames.size()), chip, exposure, spot));
      if (!again || coded) add_noise(frames.back(), again ? 0.3 : noise, random);
      expected.push_back(again);
    }
    CAPTURE(draw);
    CHECK(repeated(frames) == expected);
  }
}

TEST_CASE("steady light and chips that drift slowly from frame to frame are no frames given twice") {
  std::mt19937 random(2);
  const std::vector<double> steady(1000, 1.0);
  std::vector<double> chips(40);
  for (std::size_t k = 0; k < chips.size(); ++k) chips[k] = random() % 2 == 0 ? 0 : 1;
  std::vector<std::vector<double>> still, drifting;
  for (std::size_t k = 0; k < kFrames; ++k) {
    still.push_back(frame_of(steady, 0, 5, 10, 200));
    drifting.push_back(frame_of(chips, 0.5 * static_cast<double>(k), 5, 10, 200));  // the chips' cycle: a frame's time
    add_noise(still.back(), 0.5, random);
    add_noise(drifting.back(), 0.5, random);
  }
  CHECK(repeated(still) == std::vector<std::uint8_t>(kFrames));
  CHECK(repeated(drifting) == std::vector<std::uint8_t>(kFrames));
  CHECK(repeated({still[0], still[0]}) == std::vector<std::uint8_t>(2));
}
