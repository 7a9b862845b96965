// Standard output in whole lines, and messages on standard error.
#pragma once

#include <string_view>

namespace ocisac::apps {

// Opens the closed ones among descriptors 0, 1 and 2, so that no file or pipe of the program gets their number. Reading
// the input and writing the output then fail as they would on a closed descriptor.
void open_standard_descriptors();

// Writes the whole text to a descriptor, which may be non-blocking, so that the reader of a pipe receives each frame at
// once. Returns false if the reader has closed the pipe, or has not read for a quarter of a second after a stop signal.
// Throws std::system_error where writing fails.
bool write_all(int descriptor, std::string_view text);

// Writes a line to standard error; control characters are escaped, as file names and headers may contain any. Failures
// of standard error itself are ignored.
void write_message(std::string_view text);
// Likewise, after "warning: ".
void write_warning(std::string_view text);

}  // namespace ocisac::apps
