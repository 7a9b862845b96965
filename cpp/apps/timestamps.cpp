#include "timestamps.hpp"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <system_error>
#include <thread>

#include "byte_input.hpp"
#include "ocisac/core/require.hpp"
#include "stop_signal.hpp"

namespace ocisac::apps {

namespace {

constexpr double kLongestGap = 1e9;  // frames
constexpr double kLatest = 1e15;     // ms, of any clock; squares of much larger times overflow
constexpr std::chrono::milliseconds kLongestWait{2000}, kPause{2};

std::optional<double> milliseconds(std::string_view text) {
  while (!text.empty() && (text.back() == '\r' || text.back() == ' ')) text.remove_suffix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = error == std::errc{} && end == text.data() + text.size() && std::abs(value) < kLatest;
  return whole ? std::optional(value) : std::nullopt;
}

}  // namespace

Timestamps::Timestamps(const std::string& path) : path_(path), has_writer_(!std::filesystem::is_fifo(path)) {
  if (!has_writer_) open();  // its writer waits for a reader
}

Timestamps::~Timestamps() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void Timestamps::open() {
  // Without waiting: the writer of a FIFO may first open that of the frames, which is opened after this one.
  descriptor_ = ::open(path_.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (descriptor_ < 0) throw std::system_error(errno, std::generic_category(), path_);
  require_no_output("--timestamps", path_);
}

// A camera that still writes the file may be later with a line than with its frame, and write it in parts. False on a
// stop signal and after the time, also where there are further lines.
bool Timestamps::read_line(std::string& line, std::chrono::steady_clock::time_point& until) {
  if (stop_requested() || std::chrono::steady_clock::now() > until) return false;
  const auto first = bytes_.begin();
  for (;;) {
    const auto last = first + static_cast<std::ptrdiff_t>(end_), newline = std::find(first, last, '\n');
    if (newline != last) {
      line.assign(first, newline);
      end_ = static_cast<std::size_t>(std::copy(newline + 1, last, first) - first);
      return true;
    }
    require(end_ < bytes_.size(), "--timestamps", path_, "a file with lines of fewer than 4096 characters");
    const auto got = ::read(descriptor_, bytes_.data() + end_, bytes_.size() - end_);
    if (got < 0 && errno != EINTR && errno != EAGAIN) throw std::system_error(errno, std::generic_category(), path_);
    has_writer_ = has_writer_ || got != 0;
    if (!has_writer_) until = std::chrono::steady_clock::now() + kLongestWait;
    if (got > 0)
      end_ += static_cast<std::size_t>(got);
    else if (!wait(until) && (has_writer_ || stop_requested()))
      break;
    else if (got == 0 && has_writer_)
      std::this_thread::sleep_for(kPause);
  }
  line.assign(first, first + static_cast<std::ptrdiff_t>(end_));
  end_ = 0;
  return !line.empty() && !stop_requested();
}

// Waits for bytes or the end of what is written; false on a stop signal, and after the time.
bool Timestamps::wait(std::chrono::steady_clock::time_point until) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - std::chrono::steady_clock::now());
  if (stop_requested() || left.count() <= 0) return false;
  std::array<pollfd, 2> waiting{{{descriptor_, POLLIN, 0}, {stop_descriptor(), POLLIN, 0}}};
  const int ready = ::poll(waiting.data(), waiting.size(), static_cast<int>(left.count()));
  has_writer_ = has_writer_ || waiting[0].revents != 0;  // bytes, or it ended
  return !stop_requested() && ready != 0;
}

std::optional<double> Timestamps::next(std::optional<double> frame_time) {
  if (descriptor_ < 0) open();
  std::string line;
  auto until = std::chrono::steady_clock::now() + kLongestWait;
  do {
    if (!read_line(line, until)) return std::nullopt;
  } while (line.empty() || line.front() == '#');  // "# timecode format v2"
  const auto read = milliseconds(line);
  require(read && (!last_ || *read > *last_ * 1e3), "--timestamps", path_ + ": " + line,
          "ascending times in ms, one a line");
  const double time = *read / 1e3;
  if (last_) {
    const double step = time - *last_;
    shortest_ = std::min(shortest_.value_or(step), step);
    lost_ += std::max<std::int64_t>(std::llround(std::min(step / frame_time.value_or(*shortest_), kLongestGap)) - 1, 0);
  }
  last_ = time;
  return time;
}

}  // namespace ocisac::apps
