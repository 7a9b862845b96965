/* Preloaded into a program: counts what it asks of the C library's heap, and writes it at the end into the file that
 * COUNT_ALLOCATIONS names. */
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

void* __libc_malloc(size_t bytes);
void* __libc_calloc(size_t count, size_t bytes);
void* __libc_realloc(void* block, size_t bytes);
void* __libc_memalign(size_t alignment, size_t bytes);

static unsigned long calls;

void* malloc(size_t bytes) { return ++calls, __libc_malloc(bytes); }
void* calloc(size_t count, size_t bytes) { return ++calls, __libc_calloc(count, bytes); }
void* realloc(void* block, size_t bytes) { return ++calls, __libc_realloc(block, bytes); }
void* memalign(size_t alignment, size_t bytes) { return ++calls, __libc_memalign(alignment, bytes); }
void* aligned_alloc(size_t alignment, size_t bytes) { return ++calls, __libc_memalign(alignment, bytes); }
int posix_memalign(void** block, size_t alignment, size_t bytes) {
  ++calls;
  *block = __libc_memalign(alignment, bytes);
  return *block == NULL;
}

__attribute__((destructor)) static void tell(void) {
  const unsigned long counted = calls;
  FILE* file = fopen(getenv("COUNT_ALLOCATIONS"), "w");
  if (file == NULL) return;
  fprintf(file, "%lu\n", counted);
  fclose(file);
}
