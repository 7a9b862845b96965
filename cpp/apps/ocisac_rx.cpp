// ocisac-rx: reads frames of a rolling-shutter camera and writes gain, bits and payload of its lights, one JSON object
// per frame and light.
#if __has_include(<malloc.h>)
#include <malloc.h>
#endif

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <new>
#include <stdexcept>
#include <string>
#include <system_error>

#include "output.hpp"
#include "session.hpp"
#include "settings.hpp"

namespace {

// Keeps the memory of a frame for the next one: returned to the system, it costs page faults in every frame.
void keep_memory() {
#ifdef M_TRIM_THRESHOLD            // of the GNU C library
  constexpr int kKept = 64 << 20;  // bytes
  mallopt(M_TRIM_THRESHOLD, kKept);
  mallopt(M_MMAP_THRESHOLD, kKept);
#endif
}

const std::terminate_handler usual_end = std::get_terminate();

// Libraries allocate in functions that must not throw, the parser of the command line and the destructor of JSON
// values: without memory the program ends in them. An exception that no handler has seen yet does not tell its type.
[[noreturn]] void end_without_memory() {
  try {
    if (const auto problem = std::current_exception()) std::rethrow_exception(problem);
    if (std::uncaught_exceptions() == 0) usual_end();
    std::fputs("ocisac-rx: ended by an exception, most likely std::bad_alloc\n", stderr);
  } catch (const std::bad_alloc&) {
    std::fputs("ocisac-rx: std::bad_alloc\n", stderr);
  } catch (...) {
    usual_end();
  }
  std::_Exit(ocisac::apps::kFailed);
}

}  // namespace

int main(int argc, char** argv) {
  using namespace ocisac::apps;
  const double began = seconds_now();
  std::set_terminate(end_without_memory);
  keep_memory();
  open_standard_descriptors();
  const auto fail = [](const std::exception& problem, ExitCode code) {
    write_message(problem.what());
    return code;
  };
  try {
    const auto settings = read_settings(argc, argv);
    if (settings) return run(*settings, began);
    if (!std::cout.flush()) throw std::system_error(errno, std::generic_category(), "output");  // help or version
    return kDone;
  } catch (const std::invalid_argument& problem) {
    return fail(problem, kRefused);
  } catch (const std::exception& problem) {
    return fail(problem, kFailed);
  }
}
