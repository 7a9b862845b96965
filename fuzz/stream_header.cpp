// Headers of YUV4MPEG2 and PGM streams: the bytes are the header.
#include "stream_header.hpp"

#include <string_view>

#include "fuzz.hpp"

using namespace ocisac;

namespace {

template <class Parse>
void read_header(std::string_view text, Parse parse) {
  fuzz::allow_refusal([&] {
    const auto header = parse(text);
    if (!header) return;
    const apps::FrameLayout& layout = header->layout;
    fuzz::claim(header->bytes <= text.size());
    fuzz::claim(layout.width >= 1 && layout.width <= apps::kMaxSide);
    fuzz::claim(layout.height >= 1 && layout.height <= apps::kMaxSide);
    fuzz::claim(layout.bytes >= layout.height * layout.stride && layout.bytes <= std::size_t{1} << 30);
    fuzz::claim(header->white_level > header->dark_level);
    fuzz::claim(!header->frame_rate || *header->frame_rate > 0);
    // The rest of the stream does not change the header.
    const auto alone = parse(text.substr(0, header->bytes));
    fuzz::claim(alone && alone->layout.bytes == layout.bytes && alone->bytes == header->bytes);
  });
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  read_header(text, apps::y4m_header);
  if (apps::begins_pgm(text)) read_header(text, apps::pgm_header);
  return 0;
}
