#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <random>
#include <stdexcept>
#include <vector>

#include "packets/reed_solomon.hpp"

using ocisac::ReedSolomon;

TEST_CASE("code words are those of the definition") {
  // Parity of the data 0, 1, 2, … by an independent implementation (reedsolo 1.7, first root α⁰, polynomial 0x11d).
  std::vector<std::uint8_t> data(251);
  std::iota(data.begin(), data.end(), std::uint8_t{0});
  auto word = ReedSolomon(251).encode(data);
  CHECK(std::equal(data.begin(), data.end(), word.begin()));
  CHECK(std::vector<int>(word.begin() + 251, word.end()) == std::vector<int>{91, 240, 109, 61});
  word = ReedSolomon(85).encode(std::span(data).first(85));
  CHECK(std::vector<int>(word.end() - 3, word.end()) == std::vector<int>{205, 16, 98});
}

TEST_CASE("errors and erasures are corrected as far as the code reaches") {
  std::mt19937 random(11);
  for (const std::size_t data : {1U, 2U, 85U, 128U, 223U, 251U, 253U, 254U}) {
    const ReedSolomon code(data);
    const std::size_t roots = 255 - data;
    for (int trial = 0; trial < 60; ++trial) {
      std::vector<std::uint8_t> sent(data);
      for (auto& symbol : sent) symbol = static_cast<std::uint8_t>(random());
      const auto word = code.encode(sent);
      std::vector<int> places(255);
      std::iota(places.begin(), places.end(), 0);
      std::shuffle(places.begin(), places.end(), random);
      const std::size_t erasures = random() % (roots + 1), errors = (roots - erasures) / 2;
      auto received = word;
      for (std::size_t k = 0; k < erasures; ++k)
        received[static_cast<std::size_t>(places[k])] = static_cast<std::uint8_t>(random());
      for (std::size_t k = erasures; k < erasures + errors; ++k)
        received[static_cast<std::size_t>(places[k])] ^= static_cast<std::uint8_t>(1 + random() % 255);
      CAPTURE(data);
      CAPTURE(erasures);
      CHECK(code.decode(received, std::span(places).first(erasures)));
      CHECK(received == word);
    }
  }
}

TEST_CASE("a word that is beyond correction stays as it was") {
  std::mt19937 random(13);
  const ReedSolomon code(223);
  int refused = 0;
  for (int trial = 0; trial < 50; ++trial) {
    ReedSolomon::Word noise{};
    for (auto& symbol : noise) symbol = static_cast<std::uint8_t>(random());
    auto received = noise;
    if (!code.decode(received, {})) {
      ++refused;
      CHECK(received == noise);
    }
  }
  CHECK(refused == 50);
  ReedSolomon::Word word{};
  const std::vector<int> too_many(33);
  CHECK(!code.decode(word, too_many));
  CHECK_THROWS_AS(ReedSolomon(0), std::invalid_argument);
  CHECK_THROWS_AS(ReedSolomon(255), std::invalid_argument);
}
