// SIGINT and SIGTERM: the program completes the current frame and exits normally.
#pragma once

namespace ocisac::apps {

// Installs the handlers; a closed pipe becomes an error of the write instead of a signal. Throws std::system_error.
void catch_stop_signals();

bool stop_requested();

// Descriptor to poll: readable after a stop signal. -1 before catch_stop_signals().
int stop_descriptor();

}  // namespace ocisac::apps
