#include "core/check_interrupt.hpp"

#include <atomic>
#include <chrono>

namespace ocisac {

namespace {

using Clock = std::chrono::steady_clock;

constexpr auto kBetweenChecks = std::chrono::milliseconds(50);

std::atomic<InterruptCheck> the_check = nullptr;
thread_local int helping = 0;
thread_local Clock::time_point due{};

}  // namespace

void set_interrupt_check(InterruptCheck check) { the_check = check; }

void check_interrupt() {
  const InterruptCheck check = the_check.load(std::memory_order_relaxed);
  if (check == nullptr || helping > 0) return;
  const auto now = Clock::now();
  if (now < due) return;
  due = now + kBetweenChecks;
  check();
}

WithoutInterrupts::WithoutInterrupts() { ++helping; }
WithoutInterrupts::~WithoutInterrupts() { --helping; }

}  // namespace ocisac
