// Injects one fault into each run: the n-th call of a kind fails, for every n to the end. Allowed are an exception, an
// error code or a message; nothing is leaked, and the same call then gives its answer.
// usage: ocisac_fault_tests SECONDS OCISAC_RX LIBRARY [SCENARIO...]
// SECONDS: of each scenario, which then leaves out some n; 0: all n. SCENARIO: its name; none: all
#include <fcntl.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "injection.hpp"
#include "scenarios.hpp"

namespace {

using namespace ocisac::faults;

constexpr long kNever = std::numeric_limits<long>::max();

// The C library ends a program that first touches a thread's own object without memory for the note to destroy it.
constexpr std::string_view kEndOfLibrary = "Fatal glibc error: failed to register TLS destructor";

struct Tally {
  long runs = 0, failures = 0, ended_by_library = 0;
};

// What runs now, for the message of a crash.
std::string current;

double seconds_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void fail(Tally& tally, const std::string& what) {
  ++tally.failures;
  std::printf("FAILED %s: %s\n", current.c_str(), what.c_str());
}

// Distance of the n that are tried, so that they take at most `seconds`.
long step_for(long calls, double seconds_of_run, double seconds) {
  return seconds == 0 ? 1 : std::max(1L, static_cast<long>(static_cast<double>(calls) * seconds_of_run / seconds));
}

// The answer, or none where the call threw.
std::optional<std::string> answer_of(const Scenario& scenario) {
  try {
    return scenario.run();
  } catch (const std::logic_error&) {  // a claim of the scenario
    throw;
  } catch (const std::exception&) {
    return std::nullopt;
  }
}

// Helpers of the library may free what they were given a little later.
bool settles_at(long live) {
  for (int wait = 0; wait < 200 && live_allocations() != live; ++wait) ::usleep(100);
  return live_allocations() == live;
}

void inject(const Scenario& scenario, double seconds, Tally& tally) {
  current = scenario.name;
  const std::string expected = scenario.run();
  scenario.run();  // what is kept from call to call is there now
  const double began = seconds_now();
  arm(Kind::allocation, kNever);
  scenario.run();
  const long calls = disarm();
  const long step = step_for(calls, 2 * (seconds_now() - began), seconds);
  long live = live_allocations();
  long runs = 0;
  for (long n = 1; n <= calls; n += step, ++runs) {
    current = scenario.name + (", allocation " + std::to_string(n));
    arm(Kind::allocation, n);
    if (answer_of(scenario).value_or(expected) != expected) fail(tally, "another answer");
    disarm();
    if (!settles_at(live)) {
      if (!failed_in_opencv()) fail(tally, std::to_string(live_allocations() - live) + " allocations leaked");
      live = live_allocations();
    }
    if (answer_of(scenario) != expected) fail(tally, "another answer afterwards");
  }
  tally.runs += runs;
  std::printf("%-28s %6ld of %6ld allocations\n", scenario.name, runs, calls);
}

// Threads are kept from call to call: each fault has a process of its own.
void inject_threads(const Scenario& scenario, Tally& tally) {
  for (long n = 1; n <= 4; ++n, ++tally.runs) {
    current = scenario.name + (", thread " + std::to_string(n));
    const pid_t child = ::fork();
    if (child == 0) {
      arm(Kind::thread, n);
      const auto answer = answer_of(scenario);
      disarm();
      const auto again = answer_of(scenario);
      ::_exit(again && (!answer || answer == again) ? 0 : 1);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    if (status != 0) fail(tally, "status " + std::to_string(status));
  }
}

// Whole lines, each a JSON object.
bool are_whole_lines(std::string_view text) {
  while (!text.empty()) {
    const auto end = text.find('\n');
    if (end == text.npos || !text.starts_with('{') || text[end - 1] != '}') return false;
    text.remove_prefix(end + 1);
  }
  return true;
}

struct MemoryFile {
  int descriptor = ::memfd_create("fault", 0);

  explicit MemoryFile(std::string_view content = {}) {
    if (::pwrite(descriptor, content.data(), content.size(), 0) < 0) std::abort();
  }
  ~MemoryFile() { ::close(descriptor); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  [[nodiscard]] std::string path() const { return "/dev/fd/" + std::to_string(descriptor); }
  [[nodiscard]] std::string content() const {
    std::string text(static_cast<std::size_t>(::lseek(descriptor, 0, SEEK_END)), '\0');
    if (::pread(descriptor, text.data(), text.size(), 0) < 0) std::abort();
    return text;
  }
};

struct Finished {
  int status = 0;
  long calls = 0;
  std::string output, messages;
};

struct Program {
  const char* path;
  const char* library;
  MemoryFile input{stream_of_ten_frames()},
      config{"row-time = \"20us\"\nexposure = \"40us\"\nchip-rate = \"12.5kHz\"\n"};

  [[nodiscard]] Finished run(Kind kind, long n) const {
    const MemoryFile output, messages, report;
    std::vector<std::string> words{path, "--config", config.path(), input.path()};
    std::vector<std::string> variables{
        std::string("LD_PRELOAD=") + library, "FAULT_KIND=" + std::to_string(static_cast<int>(kind)),
        "FAULT_AT=" + std::to_string(n), "FAULT_REPORT=" + std::to_string(report.descriptor)};
    std::vector<char*> arguments, environment;
    for (auto& word : words) arguments.push_back(word.data());
    for (auto& variable : variables) environment.push_back(variable.data());
    arguments.push_back(nullptr);
    environment.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawn_file_actions_adddup2(&actions, output.descriptor, STDOUT_FILENO);
    ::posix_spawn_file_actions_adddup2(&actions, messages.descriptor, STDERR_FILENO);
    pid_t child = 0;
    if (::posix_spawn(&child, path, &actions, nullptr, arguments.data(), environment.data()) != 0) std::abort();
    ::posix_spawn_file_actions_destroy(&actions);
    Finished finished;
    ::waitpid(child, &finished.status, 0);
    if (::pread(report.descriptor, &finished.calls, sizeof finished.calls, 0) < 0) std::abort();
    finished.output = output.content();
    finished.messages = messages.content();
    return finished;
  }
};

void inject(const Program& program, Kind kind, double seconds, Tally& tally) {
  const std::string name = std::string("ocisac-rx, ") + kKindNames[static_cast<std::size_t>(kind)];
  current = name;
  const double began = seconds_now();
  const Finished sound = program.run(kind, kNever);
  if (sound.status != 0 || sound.output.empty()) return fail(tally, "without a fault: " + sound.messages);
  const long step = step_for(sound.calls, seconds_now() - began, seconds);
  long runs = 0;
  for (long n = 1; n <= sound.calls; n += step, ++runs) {
    current = name + " " + std::to_string(n);
    const Finished finished = program.run(kind, n);
    if (finished.messages.starts_with(kEndOfLibrary)) {
      ++tally.ended_by_library;
      continue;
    }
    if (!WIFEXITED(finished.status)) fail(tally, "signal " + std::to_string(WTERMSIG(finished.status)));
    if (finished.status != 0 && !finished.messages.starts_with("ocisac-rx: ")) fail(tally, "no message");
    if (!are_whole_lines(finished.output)) fail(tally, "half a line");
  }
  tally.runs += runs;
  std::printf("%-28s %6ld of %6ld calls\n", name.c_str(), runs, sound.calls);
}

int finish(const Tally& tally) {
  std::printf("%ld faults, %ld failures, %ld ended by the C library\n", tally.runs, tally.failures,
              tally.ended_by_library);
  return tally.runs > 0 && tally.failures == 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  const std::vector<std::string> chosen(argv + 4, argv + argc);
  const auto is_chosen = [&](const std::string& name) {
    return chosen.empty() || std::ranges::find(chosen, name) != chosen.end();
  };
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  for (const int signal : {SIGABRT, SIGSEGV})
    std::signal(signal, [](int number) {
      std::fprintf(stderr, "signal %d in %s\n", number, current.c_str());
      std::_Exit(1);
    });
  const double seconds = std::atof(argv[1]);
  Tally tally;
  for (const auto& scenario : scenarios())
    if (is_chosen(scenario.name)) inject_threads(scenario, tally);
  for (const auto& scenario : scenarios())
    if (is_chosen(scenario.name)) inject(scenario, seconds, tally);
  const Program program{.path = argv[2], .library = argv[3]};
  if (!is_chosen("ocisac-rx")) return finish(tally);
  for (const Kind kind : {Kind::allocation, Kind::read, Kind::write, Kind::map, Kind::thread})
    inject(program, kind, seconds, tally);
  return finish(tally);
}
