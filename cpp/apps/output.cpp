#include "output.hpp"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <string>
#include <system_error>

#include "stop_signal.hpp"

namespace ocisac::apps {

namespace {

constexpr int kLastChance = 250;  // ms allowed to a slow reader after a stop signal

// Waits until the descriptor accepts PIPE_BUF bytes without blocking; false if the program must stop.
bool wait_for_room(int descriptor) {
  for (;;) {
    const bool stopping = stop_requested();
    std::array<pollfd, 2> waiting{{{descriptor, POLLOUT, 0}, {stopping ? -1 : stop_descriptor(), POLLIN, 0}}};
    const int ready = ::poll(waiting.data(), waiting.size(), stopping ? kLastChance : -1);
    if (ready > 0 && waiting[0].revents != 0) return true;  // also for errors, which the write reports
    if (ready == 0) return false;
    if (ready < 0 && errno != EINTR) throw std::system_error(errno, std::generic_category(), "output");
  }
}

std::string without_controls(std::string_view text) {
  std::string line;
  for (std::size_t k = 0; k < text.size(); ++k) {
    const auto byte = static_cast<unsigned char>(text[k]);
    const auto next = k + 1 < text.size() ? static_cast<unsigned char>(text[k + 1]) : 0U;
    const bool control = byte < 0x20 || byte == 0x7F || (byte == 0xC2 && next >= 0x80 && next < 0xA0);  // C0, DEL, C1
    if (!control) {
      line += text[k];
      continue;
    }
    std::array<char, 5> escape{};
    std::snprintf(escape.data(), escape.size(), "\\x%02x",
                  byte == 0xC2 ? static_cast<unsigned>(text[++k]) & 0xFF : byte);
    line += escape.data();
  }
  return line;
}

}  // namespace

void open_standard_descriptors() {
  constexpr std::array<int, 3> modes{O_WRONLY, O_RDONLY, O_WRONLY};
  for (int descriptor = 0; descriptor < 3; ++descriptor)
    if (::fcntl(descriptor, F_GETFD) < 0) ::open("/dev/null", modes[static_cast<std::size_t>(descriptor)]);
}

bool write_all(int descriptor, std::string_view text) {
  while (!text.empty()) {
    if (!wait_for_room(descriptor)) return false;
    // A longer write could block in spite of the poll, and would miss a signal that came just before.
    const auto written = ::write(descriptor, text.data(), std::min<std::size_t>(text.size(), PIPE_BUF));
    if (written >= 0)
      text.remove_prefix(static_cast<std::size_t>(written));
    else if (errno == EPIPE)
      return false;
    else if (errno != EINTR && errno != EAGAIN)
      throw std::system_error(errno, std::generic_category(), "output");
  }
  return true;
}

void write_message(std::string_view text) {
  try {
    write_all(STDERR_FILENO, "ocisac-rx: " + without_controls(text) + "\n");
  } catch (const std::system_error&) {  // see the declaration
  }
}

void write_warning(std::string_view text) { write_message("warning: " + std::string(text)); }

}  // namespace ocisac::apps
