// Standard output, a whole line at a time, and messages on standard error.
#pragma once

#include <string_view>

namespace ocisac::apps {

// Opens those of the descriptors 0, 1 and 2 that are closed, so that no file or pipe of the program gets their number.
// Reading the input and writing the output then fail, as they would on a closed descriptor.
void open_standard_descriptors();

// Writes all of it to a descriptor, which may be non-blocking, so that a reader behind a pipe sees each frame at once.
// False where the reader has gone, or where the program was told to stop and nobody read for a quarter of a second.
// Throws std::system_error where writing fails.
bool write_all(int descriptor, std::string_view text);

// A line on standard error; control characters are escaped, as file names and headers may hold any. Failures of
// standard error itself are ignored: there is no place left to report them.
void write_message(std::string_view text);

}  // namespace ocisac::apps
