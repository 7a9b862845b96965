// SIGINT and SIGTERM: the program is told to stop, ends the frame it is at and goes in order.
#pragma once

namespace ocisac::apps {

// From now on these signals only ask to stop; a closed pipe is an error of the write, no signal. Throws
// std::system_error.
void catch_stop_signals();

bool stop_requested();

// A descriptor to wait on beside another: readable once the program is told to stop. -1 before catch_stop_signals().
int stop_descriptor();

}  // namespace ocisac::apps
