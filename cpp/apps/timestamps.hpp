// Times of raw frames from a file of one time a line, ms, as `rpicam-vid --save-pts` writes it.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

namespace ocisac::apps {

class Timestamps {
 public:
  // A FIFO is opened at once without waiting, a file for the first frame, when a camera that was started at the same
  // time has made it.
  explicit Timestamps(const std::string& path);
  ~Timestamps();
  Timestamps(const Timestamps&) = delete;
  Timestamps& operator=(const Timestamps&) = delete;

  // Time of the next frame in s; absent if no line with one comes within two seconds, which count from the first writer
  // of a FIFO on, or on a stop signal, whatever else comes.
  // `frame_time`: s, to count lost frames; absent: the shortest interval so far. Throws std::invalid_argument for other
  // text, and for times that do not ascend; std::system_error for a file that cannot be read.
  std::optional<double> next(std::optional<double> frame_time);

  // Frames that the times show to be lost, up to the last frame.
  [[nodiscard]] std::int64_t lost() const { return lost_; }

 private:
  void open();
  bool read_line(std::string& line, std::chrono::steady_clock::time_point& until);
  bool wait(std::chrono::steady_clock::time_point until);

  std::string path_;
  bool has_writer_;  // false: a FIFO that no writer has opened, which is waited for
  int descriptor_ = -1;
  std::array<char, 4096> bytes_{};  // of the file, up to `end_` after the line that was read last; no line is longer
  std::size_t end_ = 0;
  std::optional<double> shortest_, last_;  // interval of frames and the last time, s
  std::int64_t lost_ = 0;
};

}  // namespace ocisac::apps
