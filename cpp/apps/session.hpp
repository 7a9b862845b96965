// A run of ocisac-rx: frames in, lines out.
#pragma once

#include "settings.hpp"

namespace ocisac::apps {

// How the program ends.
enum ExitCode : int {
  kDone = 0,       // the input ended, the reader of the output went, or a signal came
  kFailed = 1,     // reading or writing failed
  kRefused = 2,    // options or input without meaning
  kNoPayload = 3,  // --payload, and none came whole
};

// `began`: when the program did, s of a steady clock.
ExitCode run(const Settings& settings, double began);

// Of a steady clock.
double seconds_now();

}  // namespace ocisac::apps
