// A run of ocisac-rx, from frames to lines of output.
#pragma once

#include "settings.hpp"

namespace ocisac::apps {

// Exit codes of the program.
enum ExitCode : int {
  kDone = 0,       // the input ended, the reader of the output closed it, or a signal came
  kFailed = 1,     // reading or writing failed
  kRefused = 2,    // invalid options or input
  kNoPayload = 3,  // --payload, and none was complete
};

// `began`: start of the program, s of a steady clock.
ExitCode run(const Settings& settings, double began);

// Time of a steady clock, s.
double seconds_now();

}  // namespace ocisac::apps
