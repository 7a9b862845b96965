// Real pipelines. The plugin is found by GST_PLUGIN_PATH, warnings of GLib are fatal (CMakeLists.txt).
#include <gst/gst.h>

#define DOCTEST_CONFIG_IMPLEMENT
#include <doctest/doctest.h>

int main(int argc, char** argv) {
  gst_init(&argc, &argv);
  const int result = doctest::Context(argc, argv).run();
  gst_deinit();  // so that the tracer of leaks reports
  return result;
}
