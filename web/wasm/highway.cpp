// Aligned memory of Highway, whose library Debian has for its own processors only; WebAssembly needs its headers alone.
#include <hwy/aligned_allocator.h>
#include <stdlib.h>

namespace hwy {

void* AllocateAlignedBytes(std::size_t payload_size, AllocPtr, void*) {
  const std::size_t whole = (payload_size + HWY_ALIGNMENT - 1) / HWY_ALIGNMENT * HWY_ALIGNMENT;
  return whole < payload_size ? nullptr : aligned_alloc(HWY_ALIGNMENT, whole);
}

void FreeAlignedBytes(const void* aligned_pointer, FreePtr, void*) { free(const_cast<void*>(aligned_pointer)); }

}  // namespace hwy
