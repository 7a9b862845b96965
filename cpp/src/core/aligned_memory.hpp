// Memory for vectors, in lines of the cache.
#pragma once

#include <hwy/aligned_allocator.h>

#include <cstddef>
#include <new>

namespace ocisac {

// Grows and is kept; what it held is lost when it grows.
template <class T>
class AlignedMemory {
 public:
  [[nodiscard]] T* at_least(std::size_t size) {
    if (size_ < size) {
      size_ = 0;
      values_ = hwy::AllocateAligned<T>(size);
      if (!values_) throw std::bad_alloc();
      size_ = size;
    }
    return values_.get();
  }

 private:
  hwy::AlignedFreeUniquePtr<T[]> values_;
  std::size_t size_ = 0;
};

}  // namespace ocisac
