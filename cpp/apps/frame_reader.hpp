// Frames out of a stream of bytes: raw, YUV4MPEG2 or PGM; torn ones told and left out.
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

// Memory whose pages count only once bytes have come into them: a header may announce frames that never come.
struct Bytes {
  std::unique_ptr<std::uint8_t[]> data;
  std::size_t size = 0;

  // Grows it and keeps the first `kept` bytes.
  void grow(std::size_t bytes, std::size_t kept);
};

// Where bytes come from: fills as much as there is, less at the end.
using ReadBytes = std::function<std::size_t(std::span<std::uint8_t>)>;

// A whole frame. Its bytes stay until the next one is asked for.
struct Frame {
  std::size_t number = 0;  // place in the stream, torn frames counted
  std::span<const std::uint8_t> bytes;
};

class FrameReader {
 public:
  // `raw`: the layout of raw frames; absent, the stream must be one that tells its own. `told`: called for every torn
  // frame with a line that says what is wrong.
  FrameReader(ReadBytes read, std::optional<FrameLayout> raw, std::function<void(const std::string&)> told);

  // What the stream holds; nothing where it is empty. Refused: a stream that is none of those known.
  const std::optional<StreamHeader>& header() const { return header_; }

  // The next whole frame, nothing at the end.
  std::optional<Frame> next();

  [[nodiscard]] std::size_t torn() const { return torn_; }

 private:
  enum class Kind { raw, y4m, pgm };

  void recognise(const std::optional<FrameLayout>& raw);
  std::string_view ahead(std::size_t bytes);  // at least so many of what comes next, fewer at the end
  void skip(std::size_t bytes);
  bool find_frame();
  std::size_t frame_header();
  std::optional<std::size_t> cut_at(std::size_t bytes);
  void tear(const std::string& what);

  ReadBytes read_;
  std::function<void(const std::string&)> told_;
  Kind kind_ = Kind::raw;
  std::optional<StreamHeader> header_;
  std::string pgm_header_;  // every picture of a sequence has the same
  Bytes buffer_;            // [begin_, end_) is ahead
  std::size_t begin_ = 0, end_ = 0;
  std::size_t count_ = 0, torn_ = 0;
};

}  // namespace ocisac::apps
