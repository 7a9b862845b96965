// Log-likelihood ratios that agree with the line code.
#pragma once

#include <vector>

#include "ocisac/packets/packets.hpp"

namespace ocisac {

// Scales the ratios of consecutive chips towards 0 where more words violate the line code than they admit: until they
// expect as many wrong chips as the violations show. Chips of a preamble may violate it. Line code "none": as they are.
void agree_with_code(std::vector<double>& llr, const PacketFormat& format);

}  // namespace ocisac
