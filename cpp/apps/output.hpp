// Standard output, a whole line at a time.
#pragma once

#include <string_view>

namespace ocisac::apps {

// Writes all of it at once to a descriptor, so that a reader behind a pipe sees each frame at once. False where the
// reader has gone, or the program was told to stop while nobody read. Throws std::system_error where writing fails.
bool write_all(int descriptor, std::string_view text);

}  // namespace ocisac::apps
