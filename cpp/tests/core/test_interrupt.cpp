#include <doctest/doctest.h>

#include <atomic>
#include <chrono>
#include <random>
#include <stdexcept>
#include <thread>
#include <vector>

#include "core/check_interrupt.hpp"
#include "core/parallel.hpp"
#include "ocisac/chips/refine_channel.hpp"

namespace {

struct Stopped : std::runtime_error {
  Stopped() : std::runtime_error("stopped") {}
};

std::atomic<bool> stop = false;
std::atomic<int> checks = 0;
std::atomic<std::thread::id> checker;

struct WithCheck {
  WithCheck() {
    stop = false;
    checks = 0;
    ocisac::set_interrupt_check([] {
      ++checks;
      checker = std::this_thread::get_id();
      if (stop) throw Stopped();
    });
  }
  ~WithCheck() { ocisac::set_interrupt_check(nullptr); }
};

}  // namespace

TEST_CASE("blocks are interrupted in the caller's thread, and threads are usable afterwards") {
  const WithCheck installed;
  for (const int threads : {1, 4}) {
    stop = false;
    std::atomic<int> done = 0;
    CHECK_THROWS_AS(ocisac::for_each_block(1000, threads,
                                           [&](std::size_t) {
                                             std::this_thread::sleep_for(std::chrono::milliseconds(2));
                                             if (++done == 10) stop = true;
                                           }),
                    Stopped);
    CHECK(done < 400);
    CHECK(checker.load() == std::this_thread::get_id());
    stop = false;
    done = 0;
    ocisac::for_each_block(20, threads, [&](std::size_t) { ++done; });
    CHECK(done == 20);
  }
}

TEST_CASE("a search for a channel is interrupted") {
  const WithCheck installed;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> light;
  std::vector<double> rows(20000);
  for (double& row : rows) row = light(random);
  stop = true;
  std::this_thread::sleep_for(std::chrono::milliseconds(60));
  CHECK_THROWS_AS(ocisac::find_channel(
                      rows, {5.0, 0.02, {}},
                      [](const ocisac::ChipQuestion& question) { return std::vector<double>(question.count); }, {}),
                  Stopped);
  CHECK(checks >= 1);
}
