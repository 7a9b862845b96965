// Real pipelines. The plugin is found by GST_PLUGIN_PATH, warnings of GLib are fatal (CMakeLists.txt).
#include <gst/gst.h>

#define DOCTEST_CONFIG_IMPLEMENT
#include <doctest/doctest.h>

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/lsan_interface.h>
// The search for leaks begins in main: GLib allocates its first table of 2048 quarks (16 kB) as it loads, and gives it
// up without freeing it when there are more, so that it can be read without a lock (quark_new in gquark.c).
__attribute__((section(".preinit_array"), used)) static void (*const before_libraries)() = __lsan_disable;
#endif

int main(int argc, char** argv) {
#ifdef __SANITIZE_ADDRESS__
  __lsan_enable();
#endif
  gst_init(&argc, &argv);
  const int result = doctest::Context(argc, argv).run();
  gst_deinit();  // so that the tracer of leaks reports
  return result;
}
