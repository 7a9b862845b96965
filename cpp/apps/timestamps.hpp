// Times of raw frames from a file of one time a line, ms, as `rpicam-vid --save-pts` writes it.
#pragma once

#include <cstdint>
#include <fstream>
#include <optional>
#include <string>

namespace ocisac::apps {

class Timestamps {
 public:
  // `frame_time`: s; absent: the shortest interval so far. Throws std::system_error for a file that cannot be read.
  Timestamps(const std::string& path, std::optional<double> frame_time);

  // Time of the next frame in s; absent after the last line. Throws std::invalid_argument for other text, and for times
  // that do not ascend.
  std::optional<double> next();

  // Frames that the times show to be lost, up to the last frame.
  [[nodiscard]] std::int64_t lost() const { return lost_; }

 private:
  std::string path_;
  std::ifstream file_;
  std::optional<double> interval_, last_;
  bool interval_known_;
  std::int64_t lost_ = 0;
};

}  // namespace ocisac::apps
