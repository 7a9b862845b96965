#include "core/parallel.hpp"

#if __has_include(<Eigen/ThreadPool>)
#include <Eigen/ThreadPool>
#else
#include <unsupported/Eigen/CXX11/ThreadPool>
#endif
#include <pthread.h>
#include <sched.h>
#include <signal.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <memory>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "core/check_interrupt.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

// Fewer threads than requested are no error: the caller does the remaining work. Helpers block all signals.
struct Environment : Eigen::StlThreadEnvironment {
  struct EnvThread {
    void OnCancel() {}
  };
  EnvThread* CreateThread(const std::function<void()>& loop) {
    try {
      std::thread started([loop] {
        sigset_t all;
        sigfillset(&all);
        pthread_sigmask(SIG_BLOCK, &all, nullptr);
        loop();
      });
      threads->push_back(started.native_handle());
      started.detach();
    } catch (const std::system_error&) {
    }
    return new EnvThread;
  }
  std::vector<pthread_t>* threads;
};

struct Helpers {
  explicit Helpers(int count) : pool(count, Environment{{}, &threads}) {}

  std::vector<pthread_t> threads;
#ifdef __linux__
  cpu_set_t processors{};  // that the threads may use; none before the first call
#endif
  Eigen::ThreadPoolTempl<Environment> pool;
};

std::mutex of_helpers;
Helpers* kept_helpers = nullptr;

// Linux may wake a helper on the processor of its caller while another one is idle, where no level of the topology says
// that they share a cache (many virtual machines): the two take turns of 4 ms and are no faster than one. So helpers
// use the caller's processors without the one that it is on.
void keep_off_caller([[maybe_unused]] Helpers& helpers) {
#ifdef __linux__
  constexpr std::size_t kMostHelpers = 15;  // a system call each; more processors leave room anyway
  const int own = sched_getcpu();
  cpu_set_t others;
  if (own < 0 || helpers.threads.size() > kMostHelpers ||
      pthread_getaffinity_np(pthread_self(), sizeof others, &others) != 0)
    return;
  if (CPU_COUNT(&others) > 1) CPU_CLR(own, &others);
  if (CPU_EQUAL(&others, &helpers.processors)) return;
  for (const pthread_t thread : helpers.threads) pthread_setaffinity_np(thread, sizeof others, &others);
  helpers.processors = others;
#endif
}

// Created at first use and never destroyed: threads may be at work while the process ends. A forked child has none of
// its parent's threads and creates its own. Null on a single processor.
Helpers* helpers() {
  static const int processors = static_cast<int>(std::thread::hardware_concurrency());
  static const bool ready_for_fork = pthread_atfork([] { of_helpers.lock(); }, [] { of_helpers.unlock(); },
                                                    [] {
                                                      kept_helpers = nullptr;
                                                      of_helpers.unlock();
                                                    }) == 0;
  if (processors < 2 || !ready_for_fork) return nullptr;
  const std::lock_guard lock(of_helpers);
  if (!kept_helpers) kept_helpers = new Helpers(processors - 1);
  keep_off_caller(*kept_helpers);
  return kept_helpers;
}

// The blocks of one call. A helper that wakes after the call has returned finds no block and does not touch `work`.
class Job {
 public:
  Job(std::size_t blocks, const std::function<void(std::size_t)>& work) : blocks_(blocks), work_(work) {}

  // Runs blocks until none is left.
  void run() {
    try {
      for (std::size_t block; (block = next_.fetch_add(1)) < blocks_;) {
        check_interrupt();
        work_(block);
      }
    } catch (...) {
      next_ = blocks_;
      const std::lock_guard lock(problem_mutex_);
      if (!problem_) problem_ = std::current_exception();
    }
  }

  void help() {
    int now = at_work_;
    do {
      if (now >= kClosed) return;
    } while (!at_work_.compare_exchange_weak(now, now + 1));
    {
      const WithoutInterrupts helping;
      run();
    }
    if (at_work_.fetch_sub(1) == kClosed + 1) at_work_.notify_all();
  }

  // Admits no further helper and waits for those at work.
  void finish() {
    int now = at_work_.fetch_add(kClosed) + kClosed;
    // The last blocks end within a few iterations; a wake-up needs 50 µs.
    for (int tries = 0; now != kClosed && tries < 1000; now = at_work_, ++tries) std::this_thread::yield();
    for (; now != kClosed; now = at_work_) at_work_.wait(now);
    if (problem_) std::rethrow_exception(std::exchange(problem_, nullptr));
  }

 private:
  static constexpr int kClosed = 1 << 20;  // beside the number of helpers

  const std::size_t blocks_;
  const std::function<void(std::size_t)>& work_;
  std::atomic<std::size_t> next_ = 0;
  std::atomic<int> at_work_ = 0;
  std::mutex problem_mutex_;
  std::exception_ptr problem_;
};

// At most `count` threads; fewer where memory does not suffice.
void call_helpers(const std::shared_ptr<Job>& job, std::size_t count) {
  Helpers* const kept = helpers();
  if (!kept) return;
  count = std::min(count, static_cast<std::size_t>(kept->pool.NumThreads()));
  try {
    for (std::size_t i = 0; i < count; ++i) kept->pool.Schedule([job] { job->help(); });
  } catch (const std::bad_alloc&) {
  }
}

}  // namespace

void for_each_block(std::size_t blocks, int threads, const std::function<void(std::size_t)>& work) {
  require(threads >= 1 && threads <= 1024, "threads", threads, "1 to 1024");
  if (threads == 1 || blocks < 2) {
    for (std::size_t block = 0; block < blocks; ++block) {
      check_interrupt();
      work(block);
    }
    return;
  }
  const auto job = std::make_shared<Job>(blocks, work);
  call_helpers(job, std::min(static_cast<std::size_t>(threads), blocks) - 1);
  job->run();
  job->finish();
}

}  // namespace ocisac
