// Replaces functions of the GNU C library. As a preloaded library it is armed from the beginning of main by FAULT_KIND
// (a number) and FAULT_AT, and writes the number of calls to the descriptor FAULT_REPORT at the end.
#include "injection.hpp"

#include <dlfcn.h>
#include <execinfo.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <cstring>

extern "C" {
void* __libc_malloc(std::size_t);  // NOLINT(bugprone-reserved-identifier): names of the library, as all below
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void __libc_free(void*);
}

namespace ocisac::faults {

namespace {

std::atomic<int> armed{-1};
std::atomic<long> fatal{0}, calls{0}, live{0};
std::atomic<bool> in_opencv{false};

bool fails(Kind kind) { return armed.load() == static_cast<int>(kind) && ++calls == fatal.load(); }

void* allocated(void* memory) {
  if (memory != nullptr) ++live;
  return memory;
}

void* no_memory() {
  armed = -1;
  std::array<void*, 12> callers{};
  const auto count = static_cast<std::size_t>(::backtrace(callers.data(), static_cast<int>(callers.size())));
  in_opencv = std::any_of(callers.begin(), callers.begin() + count, [](void* caller) {
    Dl_info library{};
    return ::dladdr(caller, &library) != 0 && std::strstr(library.dli_fname, "libopencv") != nullptr;
  });
  errno = ENOMEM;
  return nullptr;
}

template <class Function>
Function* original(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

using Main = int(int, char**, char**);
Main* program = nullptr;

int armed_main(int argc, char** argv, char** environment) {
  const char* kind = std::getenv("FAULT_KIND");
  if (kind == nullptr) return program(argc, argv, environment);
  arm(static_cast<Kind>(std::atoi(kind)), std::atol(std::getenv("FAULT_AT")));
  const int code = program(argc, argv, environment);
  const long count = disarm();
  ::syscall(SYS_pwrite64, std::atoi(std::getenv("FAULT_REPORT")), &count, sizeof count, 0);
  return code;
}

}  // namespace

void arm(Kind kind, long n) {
  void* caller = nullptr;
  [[maybe_unused]] static const int loaded = ::backtrace(&caller, 1);  // it allocates at its first call
  calls = 0;
  fatal = n;
  in_opencv = false;
  armed = static_cast<int>(kind);
}

long disarm() {
  armed = -1;
  return calls;
}

long live_allocations() { return live; }

bool failed_in_opencv() { return in_opencv; }

}  // namespace ocisac::faults

using ocisac::faults::fails;
using ocisac::faults::Kind;

extern "C" {

void* malloc(std::size_t size) {
  return fails(Kind::allocation) ? ocisac::faults::no_memory() : ocisac::faults::allocated(__libc_malloc(size));
}

void* calloc(std::size_t count, std::size_t size) {
  return fails(Kind::allocation) ? ocisac::faults::no_memory() : ocisac::faults::allocated(__libc_calloc(count, size));
}

void* realloc(void* memory, std::size_t size) {
  if (fails(Kind::allocation)) return ocisac::faults::no_memory();
  void* larger = __libc_realloc(memory, size);
  return memory == nullptr ? ocisac::faults::allocated(larger) : larger;
}

void* aligned_alloc(std::size_t alignment, std::size_t size) {
  return fails(Kind::allocation) ? ocisac::faults::no_memory()
                                 : ocisac::faults::allocated(__libc_memalign(alignment, size));
}

int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  void* got = aligned_alloc(alignment, size);
  if (got == nullptr) return ENOMEM;
  *memory = got;
  return 0;
}

void free(void* memory) {
  if (memory != nullptr) --ocisac::faults::live;
  __libc_free(memory);
}

ssize_t read(int descriptor, void* bytes, std::size_t size) {
  if (!fails(Kind::read)) return ::syscall(SYS_read, descriptor, bytes, size);
  errno = EIO;
  return -1;
}

ssize_t write(int descriptor, const void* bytes, std::size_t size) {
  if (!fails(Kind::write)) return ::syscall(SYS_write, descriptor, bytes, size);
  errno = ENOSPC;
  return -1;
}

void* mmap(void* address, std::size_t size, int protection, int flags, int descriptor, off_t offset) noexcept {
  if (!fails(Kind::map))
    return reinterpret_cast<void*>(::syscall(SYS_mmap, address, size, protection, flags, descriptor, offset));
  errno = ENOMEM;
  return MAP_FAILED;
}

int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*start)(void*),
                   void* argument) noexcept {
  static const auto create = ocisac::faults::original<decltype(pthread_create)>("pthread_create");
  return fails(Kind::thread) ? EAGAIN : create(thread, attributes, start, argument);
}

int __libc_start_main(ocisac::faults::Main* main, int argc, char** argv, void (*init)(), void (*fini)(),
                      void (*rtld_fini)(), void* stack_end) {
  ocisac::faults::program = main;
  return ocisac::faults::original<decltype(__libc_start_main)>("__libc_start_main")(
      ocisac::faults::armed_main, argc, argv, init, fini, rtld_fini, stack_end);
}

}  // extern "C"
