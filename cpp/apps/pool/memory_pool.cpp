#include "memory_pool.hpp"

#include <sys/mman.h>

#include <array>
#include <atomic>
#include <bit>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <new>

// NOLINTBEGIN(bugprone-reserved-identifier)
// The linker's --wrap gives the C library's own under these names, and its callers in this program to the ones below.
extern "C" {
void* __real_malloc(std::size_t bytes);
void __real_free(void* block);
void* __real_realloc(void* block, std::size_t bytes);
int __real_posix_memalign(void** block, std::size_t alignment, std::size_t bytes);
}

namespace ocisac::apps {

namespace {

constexpr std::size_t kArena = std::size_t{1} << 25;  // bytes of address space; pages count once they are touched
constexpr std::size_t kLongest = std::size_t{1}
                                 << 20;  // longer blocks, of the search for lights, go back to the system
constexpr std::size_t kUnit = 64;        // bytes: alignment, and the head of a block
constexpr std::size_t kClasses = 64;     // lengths: four an octave

struct Block {
  Block* next;
  std::size_t length_class;
};

struct Pool {
  std::atomic_flag busy;
  std::byte* begin;
  std::size_t taken, system_blocks;
  std::array<Block*, kClasses> free;
};
// Filled with zeros before any code runs: memory is asked for before constructors do.
constinit Pool pool{};

class Hold {
 public:
  Hold() {
    while (pool.busy.test_and_set(std::memory_order_acquire)) {
    }
  }
  ~Hold() { pool.busy.clear(std::memory_order_release); }
  Hold(const Hold&) = delete;
  Hold& operator=(const Hold&) = delete;
};

// Lengths in units: 1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, ...
std::size_t class_of(std::size_t units) {
  if (units <= 4) return units - 1;
  const auto octave = static_cast<std::size_t>(std::bit_width(units - 1)) - 1;  // 2^octave < units <= 2^(octave + 1)
  const std::size_t quarter =
      (units - (std::size_t{1} << octave) + (std::size_t{1} << (octave - 2)) - 1) >> (octave - 2);
  return 4 * (octave - 1) + quarter - 1;
}

std::size_t units_of(std::size_t length_class) {
  if (length_class < 4) return length_class + 1;
  const std::size_t octave = length_class / 4 + 1;
  return (std::size_t{1} << octave) + ((length_class % 4 + 1) << (octave - 2));
}

Block* head_of(void* block) { return reinterpret_cast<Block*>(static_cast<std::byte*>(block) - kUnit); }

bool is_pools(const void* block) {
  const auto* at = static_cast<const std::byte*>(block);
  return pool.begin != nullptr && at >= pool.begin && at < pool.begin + kArena;
}

void open_arena() {
  void* memory = ::mmap(nullptr, kArena, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (memory != MAP_FAILED) pool.begin = static_cast<std::byte*>(memory);
}

}  // namespace

PoolUse pool_use() {
  const Hold hold;
  return {pool.taken, pool.system_blocks};
}

void* pool_take(std::size_t bytes) {
  const std::size_t units = bytes == 0 ? 1 : (bytes + kUnit - 1) / kUnit;
  if (bytes <= kLongest) {
    const Hold hold;
    if (pool.begin == nullptr) open_arena();
    const std::size_t length_class = class_of(units);
    if (Block* block = pool.free[length_class]) {
      pool.free[length_class] = block->next;
      return reinterpret_cast<std::byte*>(block) + kUnit;
    }
    const std::size_t length = kUnit * (units_of(length_class) + 1);
    if (pool.begin != nullptr && pool.taken + length <= kArena) {
      auto* block = reinterpret_cast<Block*>(pool.begin + pool.taken);
      pool.taken += length;
      block->length_class = length_class;
      return reinterpret_cast<std::byte*>(block) + kUnit;
    }
  }
  {
    const Hold hold;
    ++pool.system_blocks;
  }
  void* block = nullptr;
  return __real_posix_memalign(&block, kUnit, bytes) == 0 ? block : nullptr;
}

void pool_give(void* block) {
  if (!is_pools(block)) {
    __real_free(block);
    return;
  }
  const Hold hold;
  Block* head = head_of(block);
  head->next = pool.free[head->length_class];
  pool.free[head->length_class] = head;
}

std::size_t pool_length(const void* block) {
  return is_pools(block) ? kUnit * units_of(head_of(const_cast<void*>(block))->length_class) : 0;
}

}  // namespace ocisac::apps

// What the program and the libraries linked into it call. NOLINTBEGIN: names and signatures are the C library's.
extern "C" {

void* __wrap_malloc(std::size_t bytes) { return ocisac::apps::pool_take(bytes); }

void __wrap_free(void* block) { ocisac::apps::pool_give(block); }

void* __wrap_calloc(std::size_t count, std::size_t size) {
  std::size_t bytes = 0;
  if (__builtin_mul_overflow(count, size, &bytes)) return nullptr;
  void* block = ocisac::apps::pool_take(bytes);
  return block == nullptr ? nullptr : std::memset(block, 0, bytes);
}

void* __wrap_realloc(void* block, std::size_t bytes) {
  if (block == nullptr) return ocisac::apps::pool_take(bytes);
  const std::size_t length = ocisac::apps::pool_length(block);
  if (length == 0) return __real_realloc(block, bytes);
  if (bytes <= length) return block;
  void* moved = ocisac::apps::pool_take(bytes);
  if (moved == nullptr) return nullptr;
  std::memcpy(moved, block, length);
  ocisac::apps::pool_give(block);
  return moved;
}

int __wrap_posix_memalign(void** block, std::size_t alignment, std::size_t bytes) {
  if (alignment > 64) return __real_posix_memalign(block, alignment, bytes);
  *block = ocisac::apps::pool_take(bytes);
  return *block == nullptr ? ENOMEM : 0;
}

}  // extern "C"

void* operator new(std::size_t bytes) {
  void* block = ocisac::apps::pool_take(bytes);
  if (block == nullptr) throw std::bad_alloc();
  return block;
}
void* operator new[](std::size_t bytes) { return operator new(bytes); }
void operator delete(void* block) noexcept { ocisac::apps::pool_give(block); }
void operator delete[](void* block) noexcept { ocisac::apps::pool_give(block); }
void operator delete(void* block, std::size_t) noexcept { ocisac::apps::pool_give(block); }
void operator delete[](void* block, std::size_t) noexcept { ocisac::apps::pool_give(block); }
// NOLINTEND(bugprone-reserved-identifier)
