// Doubts about what is stated of a stream: its times, and size and format of raw frames, which have no headers.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "pixel_format.hpp"

namespace ocisac::apps {

// A message where a file of `bytes` bytes is no whole number of frames; absent where it is.
std::optional<std::string> length_doubt(std::size_t bytes, const FrameLayout& layout);

// A message where the frame time, which the options or the stream state, is below a time that a frame holds.
std::optional<std::string> time_doubt(const Camera& camera, std::size_t rows, std::optional<double> chip_rate);

// Compares the first frames of a stream: successive pictures of one scene are alike at the distance of one frame. Signs
// of another format: rows are more alike at the size of its frames, its chroma is grey, or its high bytes are small.
// Sign of another width: edges of the picture stand one below the other at the distance of its rows.
class FormatCheck {
 public:
  explicit FormatCheck(const FrameLayout& layout) : layout_(layout) {}

  // A message with the last of the frames that are compared, if they are of another format; else absent.
  std::optional<std::string> push(std::span<const std::uint8_t> frame);

 private:
  [[nodiscard]] std::size_t rows() const { return samples_.size() / columns_; }
  [[nodiscard]] std::vector<PixelFormat> likely_formats() const;
  [[nodiscard]] double difference(std::size_t lag) const;
  [[nodiscard]] bool has_small_high_bytes() const;
  [[nodiscard]] bool has_grey_chroma(std::size_t frame_rows) const;
  [[nodiscard]] std::optional<std::size_t> other_row_bytes() const;

  FrameLayout layout_;
  std::size_t frames_ = 0;
  std::size_t columns_ = 0;  // sampled
  // (rows, columns_): the stream cut into rows of `width` bytes, whatever its format, every few columns of them.
  std::vector<std::uint8_t> samples_;
  std::vector<std::uint8_t> first_bytes_;
};

}  // namespace ocisac::apps
