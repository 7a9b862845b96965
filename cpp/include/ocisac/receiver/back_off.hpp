// Pauses after vain attempts.
#pragma once

#include <algorithm>
#include <cstddef>

namespace ocisac {

// Frames until an attempt that may be in vain is due again: twice as many after each failure beyond the `quick` first.
struct BackOff {
  std::size_t shortest, longest;  // frames from one attempt to the next
  std::size_t quick = 1;
  std::size_t failures = 0, pause = shortest;  // in a row; frames until the next attempt

  void pass_frame() { pause -= pause > 0; }
  [[nodiscard]] bool is_due() const { return pause == 0; }
  [[nodiscard]] bool is_exhausted() const { return pause_after(failures) == longest; }
  void fail() { pause = pause_after(++failures); }
  void restart() { *this = {.shortest = shortest, .longest = longest, .quick = quick}; }
  // `vain`: failures in a row.
  [[nodiscard]] std::size_t pause_after(std::size_t vain) const {
    const std::size_t doublings = vain - std::min(vain, quick);
    return std::min(shortest << std::min<std::size_t>(doublings, 16), longest);
  }
};

}  // namespace ocisac
