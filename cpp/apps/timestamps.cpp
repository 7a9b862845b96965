#include "timestamps.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <system_error>

#include "ocisac/core/require.hpp"

namespace ocisac::apps {

namespace {

constexpr double kLongestGap = 1e9;  // frames

std::optional<double> milliseconds(std::string_view text) {
  while (!text.empty() && (text.back() == '\r' || text.back() == ' ')) text.remove_suffix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = error == std::errc{} && end == text.data() + text.size() && std::isfinite(value);
  return whole ? std::optional(value) : std::nullopt;
}

}  // namespace

Timestamps::Timestamps(const std::string& path, std::optional<double> frame_time)
    : path_(path), file_(path), interval_(frame_time), interval_known_(frame_time.has_value()) {
  if (!file_) throw std::system_error(errno, std::generic_category(), path);
}

std::optional<double> Timestamps::next() {
  std::string line;
  do {
    if (!std::getline(file_, line)) return std::nullopt;
  } while (line.empty() || line.front() == '#');  // "# timecode format v2"
  const auto read = milliseconds(line);
  require(read && (!last_ || *read > *last_ * 1e3), "--timestamps", path_ + ": " + line,
          "ascending times in ms, one a line");
  const double time = *read / 1e3;
  if (last_) {
    const double step = time - *last_;
    if (!interval_known_) interval_ = std::min(interval_.value_or(step), step);
    lost_ += std::max<std::int64_t>(std::llround(std::min(step / *interval_, kLongestGap)) - 1, 0);
  }
  last_ = time;
  return time;
}

}  // namespace ocisac::apps
