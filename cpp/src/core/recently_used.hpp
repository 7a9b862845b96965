// Keeps values that are costly to make, for calls with the same parameters.
#pragma once

#include <algorithm>
#include <cstddef>
#include <list>
#include <memory>
#include <mutex>
#include <utility>

namespace ocisac {

// The `kMost` values used last; safe for threads, which may make the same value at once.
template <class Key, class Value, std::size_t kMost>
class RecentlyUsed {
 public:
  // The value of a key, or else what make() returns: a std::shared_ptr<const Value>.
  template <class Make>
  std::shared_ptr<const Value> get(const Key& key, Make make) {
    {
      const std::lock_guard lock(mutex_);
      const auto found = std::ranges::find(kept_, key, [](const Kept& each) -> const Key& { return each.first; });
      if (found != kept_.end()) {
        kept_.splice(kept_.begin(), kept_, found);
        return found->second;
      }
    }
    std::shared_ptr<const Value> made = make();
    const std::lock_guard lock(mutex_);
    kept_.emplace_front(key, made);
    if (kept_.size() > kMost) kept_.pop_back();
    return made;
  }

 private:
  using Kept = std::pair<Key, std::shared_ptr<const Value>>;

  std::mutex mutex_;
  std::list<Kept> kept_;  // most recently used first
};

}  // namespace ocisac
