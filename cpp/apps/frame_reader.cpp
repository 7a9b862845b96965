#include "frame_reader.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "ocisac/core/require.hpp"
#include "stop_signal.hpp"

namespace ocisac::apps {

namespace {

// Bytes searched at a time for the beginning of the next frame after a torn one.
constexpr std::size_t kSearchStep = 1 << 16;
// Fewest bytes at the end of a frame that count as the beginning of the next one.
constexpr std::size_t kMinMarkerBytes = 3;

std::size_t find(std::string_view text, std::string_view wanted) {
  const void* at = ::memmem(text.data(), text.size(), wanted.data(), wanted.size());
  return at == nullptr ? text.npos : static_cast<std::size_t>(static_cast<const char*>(at) - text.data());
}

}  // namespace

void Bytes::grow(std::size_t bytes, std::size_t kept) {
  if (bytes <= size) return;
  auto larger = std::make_unique_for_overwrite<std::uint8_t[]>(bytes);
  if (kept > 0) std::memcpy(larger.get(), data.get(), kept);
  data = std::move(larger);
  size = bytes;
}

FrameReader::FrameReader(ReadBytes read, std::optional<FrameLayout> raw, std::function<void(const std::string&)> warn)
    : read_(std::move(read)), warn_(std::move(warn)) {
  buffer_.grow(2 * kLongestHeader, 0);
  recognise(raw);
}

// At least `bytes` of the coming input in one piece; fewer only at the end.
std::string_view FrameReader::ahead(std::size_t bytes) {
  if (end_ - begin_ < bytes) {
    std::memmove(buffer_.data.get(), buffer_.data.get() + begin_, end_ - begin_);
    end_ -= std::exchange(begin_, 0);
    buffer_.grow(bytes, end_);
    end_ += read_({buffer_.data.get() + end_, bytes - end_});
  }
  return {reinterpret_cast<const char*>(buffer_.data.get() + begin_), std::min(bytes, end_ - begin_)};
}

void FrameReader::skip(std::size_t bytes) { begin_ += std::min(bytes, end_ - begin_); }

void FrameReader::recognise(const std::optional<FrameLayout>& raw) {
  const std::string_view first = ahead(kY4mMagic.size());
  if (first.empty()) return;
  const auto whole_header = [&](auto parse) {
    for (std::size_t bytes = 16; bytes <= kLongestHeader; bytes += 16) {
      const auto text = ahead(bytes);
      if (auto header = parse(text)) return header;
      if (text.size() < bytes) break;
    }
    refuse("input", "a header that is cut off", "a whole header");
  };
  if (first == kY4mMagic) {
    kind_ = Kind::y4m;
    header_ = whole_header(y4m_header);
    skip(header_->bytes);
  } else if (begins_pgm(first)) {
    kind_ = Kind::pgm;
    header_ = whole_header(pgm_header);
    pgm_header_ = ahead(header_->bytes);
  } else {
    require(raw.has_value(), "--size", "nothing", "WIDTHxHEIGHT in pixels: the input does not state its size");
    header_ = StreamHeader{*raw, largest_value(raw->format), 0, std::nullopt, 0};
  }
  buffer_.grow(header_->layout.bytes + kLongestHeader, end_);
}

// Size in bytes of the next frame's header; 0 if there is none.
std::size_t FrameReader::frame_header() {
  if (kind_ == Kind::pgm) {
    const auto text = ahead(pgm_header_.size());
    return text == pgm_header_ ? text.size() : 0;
  }
  if (!ahead(kY4mFrame.size()).starts_with(kY4mFrame)) return 0;
  for (std::size_t bytes = kY4mFrame.size() + 1; bytes <= kLongestHeader; ++bytes) {
    const auto text = ahead(bytes);
    if (text.size() < bytes) return 0;
    if (text.back() == '\n') return bytes;
  }
  return 0;
}

void FrameReader::tear(const std::string& what) {
  ++torn_;
  warn_("frame " + std::to_string(count_++) + " is torn: " + what + "; left out");
}

// Advances to the pixels of the next frame; false at the end. Skipped bytes count as a torn frame.
bool FrameReader::find_frame() {
  if (kind_ == Kind::raw) return !ahead(1).empty();
  const std::string_view marker = kind_ == Kind::y4m ? kY4mFrame : std::string_view(pgm_header_);
  std::size_t lost = 0;
  while (!ahead(1).empty()) {
    if (const auto bytes = frame_header()) {
      if (lost > 0) tear(std::to_string(lost) + " bytes without the header of a frame");
      skip(bytes);
      return true;
    }
    skip(1);
    const auto text = ahead(kSearchStep);
    const auto at = std::min(find(text, marker), text.size() - std::min(text.size(), marker.size() - 1));
    skip(at);
    lost += 1 + at;
    if (text.size() < marker.size()) lost += text.size(), skip(text.size());
  }
  if (lost > 0) tear(std::to_string(lost) + " bytes without the header of a frame");
  return false;
}

// Position of another frame's header within the `bytes` of this frame, which then was cut short. Waits for more input
// only if the last few bytes match the beginning of a header.
std::optional<std::size_t> FrameReader::cut_at(std::size_t bytes) {
  if (kind_ == Kind::raw) return std::nullopt;
  const std::string_view marker = kind_ == Kind::y4m ? "FRAME\n" : std::string_view(pgm_header_);
  const auto frame = ahead(bytes);
  if (const auto at = find(frame, marker); at != frame.npos) return at;
  if (frame.size() < bytes) return std::nullopt;  // at the end no header can be completed
  for (std::size_t seen = std::min(marker.size(), bytes + 1) - 1; seen >= kMinMarkerBytes; --seen) {
    if (!ahead(bytes).ends_with(marker.substr(0, seen))) continue;
    const std::size_t at = bytes - seen;
    if (ahead(at + marker.size()).substr(at) == marker) return at;
  }
  return std::nullopt;
}

std::optional<Frame> FrameReader::next() {
  if (!header_) return std::nullopt;
  const std::size_t bytes = header_->layout.bytes;
  while (find_frame()) {
    const auto cut = cut_at(bytes);
    const auto frame = ahead(bytes);
    if (!cut && frame.size() < bytes && stop_requested()) break;
    if (cut || frame.size() < bytes) {
      const std::size_t got = cut.value_or(frame.size());
      tear(std::to_string(got) + " of " + std::to_string(bytes) + " bytes");
      skip(got);
      continue;
    }
    skip(bytes);
    return Frame{count_++, {reinterpret_cast<const std::uint8_t*>(frame.data()), bytes}};
  }
  return std::nullopt;
}

}  // namespace ocisac::apps
