#include "ocisac/parallel.hpp"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include "ocisac/require.hpp"

namespace ocisac {

void for_each_block(std::size_t blocks, int threads, const std::function<void(std::size_t)>& work) {
  require(threads >= 1 && threads <= 1024, "threads", threads, "1 to 1024");
  std::atomic<std::size_t> next = 0;
  std::exception_ptr problem;
  std::mutex problem_mutex;
  const auto run = [&] {
    try {
      for (std::size_t block; (block = next.fetch_add(1)) < blocks;) work(block);
    } catch (...) {
      next = blocks;
      const std::lock_guard lock(problem_mutex);
      if (!problem) problem = std::current_exception();
    }
  };
  {
    std::vector<std::jthread> helpers;
    const auto useful = std::min(static_cast<std::size_t>(threads), blocks);
    for (std::size_t i = 1; i < useful; ++i) helpers.emplace_back(run);
    run();
  }
  if (problem) std::rethrow_exception(problem);
}

}  // namespace ocisac
