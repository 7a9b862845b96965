#include "byte_input.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <system_error>

#include "ocisac/core/require.hpp"
#include "stop_signal.hpp"

namespace ocisac::apps {

namespace {

constexpr int kPipeBytes = 1 << 20;  // larger pipe: fewer switches between writer and reader

}  // namespace

void require_no_output(const char* option, const std::string& path, bool is_standard_input) {
  struct stat in {};
  struct stat out {};
  const int found = is_standard_input ? ::fstat(STDIN_FILENO, &in) : ::stat(path.c_str(), &in);
  const bool is_output = found == 0 && ::fstat(STDOUT_FILENO, &out) == 0 && S_ISREG(in.st_mode) &&
                         in.st_dev == out.st_dev && in.st_ino == out.st_ino;
  require(!is_output, option, path, "another file than standard output, whose lines would be read");
}

ByteInput::ByteInput(const std::string& path)
    : descriptor_(path == "-" ? STDIN_FILENO : ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC)),
      owned_(path != "-") {
  if (descriptor_ < 0 && errno != ENOENT) throw std::system_error(errno, std::generic_category(), path);
  require(descriptor_ >= 0, "input", path, "a file that can be read, or -");
  require_no_output("input", path, !owned_);
#ifdef F_SETPIPE_SZ
  ::fcntl(descriptor_, F_SETPIPE_SZ, kPipeBytes);  // fails harmlessly where it is no pipe or not allowed
#endif
}

ByteInput::~ByteInput() {
  if (owned_) ::close(descriptor_);
}

std::optional<std::size_t> ByteInput::remaining() const {
  struct stat status {};
  const auto at = ::lseek(descriptor_, 0, SEEK_CUR);
  if (at < 0 || ::fstat(descriptor_, &status) < 0 || !S_ISREG(status.st_mode) || status.st_size < at)
    return std::nullopt;
  return static_cast<std::size_t>(status.st_size - at);
}

// Waits for input or its end; returns false on a stop signal.
bool ByteInput::wait() const {
  for (;;) {
    std::array<pollfd, 2> waiting{{{descriptor_, POLLIN, 0}, {stop_descriptor(), POLLIN, 0}}};
    const int ready = ::poll(waiting.data(), waiting.size(), -1);
    if (stop_requested()) return false;
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) throw std::system_error(errno, std::generic_category(), "input");
  }
}

std::size_t ByteInput::read(std::span<std::uint8_t> bytes) {
  std::size_t count = 0;
  while (count < bytes.size() && wait()) {
    const auto got = ::read(descriptor_, bytes.data() + count, bytes.size() - count);
    if (got == 0) break;
    if (got > 0)
      count += static_cast<std::size_t>(got);
    else if (errno != EINTR && errno != EAGAIN)
      throw std::system_error(errno, std::generic_category(), "input");
  }
  return count;
}

}  // namespace ocisac::apps
