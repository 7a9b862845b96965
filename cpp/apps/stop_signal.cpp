#include "stop_signal.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <system_error>

namespace ocisac::apps {

namespace {

volatile std::sig_atomic_t stop = 0;
std::array<int, 2> wake_pipe{-1, -1};

void ask_to_stop(int) {
  const int kept = errno;
  stop = 1;
  [[maybe_unused]] const auto written = ::write(wake_pipe[1], "", 1);
  errno = kept;
}

}  // namespace

void catch_stop_signals() {
  if (::pipe(wake_pipe.data()) != 0) throw std::system_error(errno, std::generic_category(), "pipe");
  for (const int end : wake_pipe) {
    ::fcntl(end, F_SETFD, FD_CLOEXEC);
    ::fcntl(end, F_SETFL, O_NONBLOCK);
  }
  struct sigaction action {};
  action.sa_handler = ask_to_stop;  // without SA_RESTART: a blocking write returns too
  for (const int signal : {SIGINT, SIGTERM}) ::sigaction(signal, &action, nullptr);
  for (const int signal : {SIGPIPE, SIGXFSZ}) ::signal(signal, SIG_IGN);  // writing fails instead
}

bool stop_requested() { return stop != 0; }

int stop_descriptor() { return wake_pipe[0]; }

}  // namespace ocisac::apps
