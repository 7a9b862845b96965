#include "output.hpp"

#include <unistd.h>

#include <cerrno>
#include <system_error>

#include "stop_signal.hpp"

namespace ocisac::apps {

bool write_all(int descriptor, std::string_view text) {
  while (!text.empty()) {
    const auto written = ::write(descriptor, text.data(), text.size());
    if (written >= 0) {
      text.remove_prefix(static_cast<std::size_t>(written));
    } else if (errno == EPIPE || (errno == EINTR && stop_requested())) {
      return false;
    } else if (errno != EINTR) {
      throw std::system_error(errno, std::generic_category(), "output");
    }
  }
  return true;
}

}  // namespace ocisac::apps
