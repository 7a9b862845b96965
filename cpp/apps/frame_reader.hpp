// Frames from a stream of bytes: raw, YUV4MPEG2 or PGM; torn frames are reported and skipped.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "stream_header.hpp"

namespace ocisac::apps {

// Uninitialised memory: pages that a header announces but no bytes fill stay unused.
struct Bytes {
  std::unique_ptr<std::uint8_t[]> data;
  std::size_t size = 0;

  // Grows the memory and keeps the first `kept` bytes.
  void grow(std::size_t bytes, std::size_t kept);
};

// Source of bytes: fills the span; fewer bytes at the end.
using ReadBytes = std::function<std::size_t(std::span<std::uint8_t>)>;

// A whole frame. Its bytes are valid until the next call of next().
struct Frame {
  std::size_t number = 0;  // position in the stream, torn frames included
  std::span<const std::uint8_t> bytes;
};

class FrameReader {
 public:
  // `raw`: the layout of raw frames; absent: the stream has headers. `warn`: called with a message for every torn
  // frame.
  FrameReader(ReadBytes read, std::optional<FrameLayout> raw, std::function<void(const std::string&)> warn);

  // Header of the stream; absent where the stream is empty. Throws for a stream of unknown format.
  const std::optional<StreamHeader>& header() const { return header_; }

  // The next whole frame; absent at the end.
  std::optional<Frame> next();

  [[nodiscard]] std::size_t torn() const { return torn_; }

 private:
  enum class Kind { raw, y4m, pgm };

  void recognise(const std::optional<FrameLayout>& raw);
  std::string_view ahead(std::size_t bytes);  // at least so many bytes of the coming input, fewer at the end
  void skip(std::size_t bytes);
  bool find_frame();
  std::size_t frame_header();
  std::optional<std::size_t> cut_at(std::size_t bytes);
  void tear(const std::string& what);

  ReadBytes read_;
  std::function<void(const std::string&)> warn_;
  Kind kind_ = Kind::raw;
  std::optional<StreamHeader> header_;
  std::string pgm_header_;  // equal for every picture of a sequence
  Bytes buffer_;            // [begin_, end_): not yet consumed
  std::size_t begin_ = 0, end_ = 0;
  std::size_t count_ = 0, torn_ = 0;
};

}  // namespace ocisac::apps
