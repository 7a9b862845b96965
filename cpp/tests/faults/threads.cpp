// Eight threads call the library at once, with objects of their own and shared ones; every answer is that of one
// thread. usage: ocisac_thread_tests SECONDS
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "scenarios.hpp"

int main(int argc, char** argv) {
  using Clock = std::chrono::steady_clock;
  if (argc != 2) return 2;
  const auto end = Clock::now() + std::chrono::duration<double>(std::atof(argv[1]));
  const auto& scenarios = ocisac::faults::scenarios();
  std::vector<std::string> expected;
  for (const auto& scenario : scenarios) expected.push_back(scenario.run());
  std::atomic<long> runs = 0, failures = 0;
  const auto work = [&](std::size_t first) {
    for (std::size_t k = first; Clock::now() < end; k = (k + 1) % scenarios.size(), ++runs)
      if (scenarios[k].run() != expected[k]) {
        ++failures;
        std::printf("FAILED %s\n", scenarios[k].name);
      }
  };
  std::vector<std::thread> threads;
  for (std::size_t thread = 0; thread < 8; ++thread) threads.emplace_back(work, 2 * thread % scenarios.size());
  for (auto& thread : threads) thread.join();
  std::printf("%ld calls of 8 threads, %ld failures\n", runs.load(), failures.load());
  return failures == 0 ? 0 : 1;
}
