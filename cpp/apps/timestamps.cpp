#include "timestamps.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <system_error>
#include <thread>

#include "ocisac/core/require.hpp"
#include "stop_signal.hpp"

namespace ocisac::apps {

namespace {

constexpr double kLongestGap = 1e9;  // frames
constexpr std::chrono::milliseconds kLongestWait{2000}, kPause{2};

std::optional<double> milliseconds(std::string_view text) {
  while (!text.empty() && (text.back() == '\r' || text.back() == ' ')) text.remove_suffix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = error == std::errc{} && end == text.data() + text.size() && std::isfinite(value);
  return whole ? std::optional(value) : std::nullopt;
}

}  // namespace

Timestamps::Timestamps(const std::string& path) : path_(path) {
  if (std::filesystem::is_fifo(path)) open();  // its writer waits for a reader
}

void Timestamps::open() {
  file_.open(path_);
  if (!file_) throw std::system_error(errno, std::generic_category(), path_);
}

// A camera that still writes the file may be later with a line than with its frame, and write it in parts.
bool Timestamps::read_line(std::string& line) {
  line.clear();
  std::string part;
  for (auto waited = kPause * 0; !stop_requested(); waited += kPause) {
    const bool whole = std::getline(file_, part) && !file_.eof();
    line += part;
    if (whole) return true;
    if (waited >= kLongestWait) break;
    file_.clear();
    std::this_thread::sleep_for(kPause);
  }
  return !line.empty();
}

std::optional<double> Timestamps::next(std::optional<double> frame_time) {
  if (!file_.is_open()) open();
  std::string line;
  do {
    if (!read_line(line)) return std::nullopt;
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
