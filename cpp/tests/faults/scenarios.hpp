// Short calls of the public interface, for the injection of faults.
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace ocisac::faults {

struct Scenario {
  const char* name;
  std::function<std::string()> run;  // gives its answer as bytes; throws where the call fails
};

const std::vector<Scenario>& scenarios();

// A stream of ten frames of a light that sends a packet, YUV4MPEG2.
std::string stream_of_ten_frames();

}  // namespace ocisac::faults
