#include <doctest/doctest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>
#include <vector>

#include "core/parallel.hpp"

using ocisac::for_each_block;

namespace {

// Number of executions of each block.
std::vector<int> turns(std::size_t blocks, int threads) {
  std::vector<std::atomic<int>> counted(blocks);
  for_each_block(blocks, threads, [&](std::size_t block) { ++counted[block]; });
  return {counted.begin(), counted.end()};
}

bool each_once(std::size_t blocks, int threads) { return turns(blocks, threads) == std::vector<int>(blocks, 1); }

// True if two blocks run at the same time, each waiting for the other; trivially true with a single processor.
bool helper_comes() {
  if (std::thread::hardware_concurrency() < 2) return true;
  std::atomic<int> begun = 0, met = 0;
  for_each_block(2, 2, [&](std::size_t) {
    ++begun;
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (begun < 2 && std::chrono::steady_clock::now() < end) std::this_thread::yield();
    if (begun == 2) ++met;
  });
  return met == 2;
}

}  // namespace

TEST_CASE("every block is worked on once") {
  for (const int threads : {1, 2, 3, 8, 1024})
    for (const std::size_t blocks : {0, 1, 2, 7, 1000}) CHECK(each_once(blocks, threads));
  CHECK_THROWS_WITH_AS(for_each_block(1, 0, [](std::size_t) {}), "threads: got 0, allowed: 1 to 1024",
                       std::invalid_argument);
}

TEST_CASE("a helper works beside the caller") { CHECK(helper_comes()); }

TEST_CASE("the first exception comes back, and the next call works") {
  for (int round = 0; round < 100; ++round) {
    std::atomic<int> at_work = 0;
    const auto work = [&](std::size_t block) {
      ++at_work;
      if (block % 5 == 3) {
        --at_work;
        throw std::runtime_error("block");
      }
      std::this_thread::yield();
      --at_work;
    };
    CHECK_THROWS_WITH_AS(for_each_block(50, 4, work), "block", std::runtime_error);
    CHECK(at_work == 0);  // all threads have finished
    CHECK(each_once(20, 4));
  }
}

TEST_CASE("callers do not wait for one another's helpers") {
  std::atomic<int> wrong = 0;
  const auto call = [&] {
    for (int round = 0; round < 500; ++round)
      if (!each_once(static_cast<std::size_t>(round) % 40, 4)) ++wrong;
  };
  {
    std::vector<std::jthread> callers;
    for (int i = 0; i < 6; ++i) callers.emplace_back(call);
  }
  CHECK(wrong == 0);
}

TEST_CASE("blocks may be divided again") {
  std::vector<std::atomic<int>> counted(64);
  for_each_block(
      8, 4, [&](std::size_t outer) { for_each_block(8, 4, [&](std::size_t inner) { ++counted[8 * outer + inner]; }); });
  for (const auto& count : counted) CHECK(count == 1);
}

TEST_CASE("a fork's child has helpers of its own, whatever its parent was doing") {
  const std::jthread busy([](const std::stop_token& stop) {
    while (!stop.stop_requested()) turns(16, 4);
  });
  for (int round = 0; round < 20; ++round) {
    CHECK(each_once(100, 4));
    const pid_t child = fork();
    REQUIRE(child >= 0);
    if (child == 0) {
      alarm(40);  // terminates a child that hangs
      _exit(each_once(100, 4) && helper_comes() ? 0 : 1);
    }
    int status = -1;
    CHECK(waitpid(child, &status, 0) == child);
    CHECK(status == 0);
  }
}
