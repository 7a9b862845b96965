// Counting instructions: `instructions NAME` runs one case once; without a name it lists them.
#include <cstdio>

#include "calls.hpp"

// Counted region: valgrind --tool=callgrind --toggle-collect=run_measured
extern "C" __attribute__((noinline)) double run_measured(const std::function<double()>& work) { return work(); }

int main(int argc, char** argv) {
  if (argc == 1) {
    for (const auto& entry : calls::kCases) std::puts(entry.first.c_str());
    return 0;
  }
  const auto found = calls::kCases.find(argv[1]);
  if (found == calls::kCases.end()) return 2;
  calls::prepare();
  std::printf("%.12g\n", run_measured(found->second));
}
