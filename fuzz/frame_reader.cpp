// Frames of a stream: the first byte is the format of raw frames, the second and third their size; the rest is the
// stream.
#include "frame_reader.hpp"

#include <algorithm>
#include <optional>

#include "fuzz.hpp"

using namespace ocisac;

namespace {

constexpr std::size_t kLargestFrame = 1 << 16;  // bytes; larger ones cost time and reach no other line

// False for headers that announce a larger frame.
bool is_small(std::string_view text) {
  bool small = true;
  fuzz::allow_refusal([&] {
    const auto header = apps::begins_pgm(text)              ? apps::pgm_header(text)
                        : text.starts_with(apps::kY4mMagic) ? apps::y4m_header(text)
                                                            : std::nullopt;
    small = !header || header->layout.bytes <= kLargestFrame;
  });
  return small;
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 3) return 0;
  std::optional<apps::FrameLayout> raw;
  const auto format = static_cast<apps::PixelFormat>(data[0] % 16);
  if (format <= apps::PixelFormat::yuyv) raw = apps::raw_layout(format, 1U + data[1], 1U + data[2]);
  std::string_view stream(reinterpret_cast<const char*>(data) + 3, size - 3);
  if (!is_small(stream)) return 0;
  std::size_t warnings = 0, bytes_read = 0, expected = 0;
  const std::size_t total = stream.size();
  const auto read = [&](std::span<std::uint8_t> bytes) {
    const std::size_t count = std::min(bytes.size(), stream.size());
    std::memcpy(bytes.data(), stream.data(), count);
    stream.remove_prefix(count);
    return count;
  };
  fuzz::allow_refusal([&] {
    apps::FrameReader reader(read, raw, [&](const std::string&) { ++warnings; });
    while (const auto frame = reader.next()) {
      fuzz::claim(frame->bytes.size() == reader.header()->layout.bytes);
      fuzz::claim(frame->number >= expected);
      expected = frame->number + 1;
      bytes_read += frame->bytes.size();
    }
    fuzz::claim(warnings == reader.torn() && bytes_read <= total && stream.empty());
    fuzz::claim(!reader.next());
  });
  return 0;
}
