// Recognition of a light in later frames by how it looked when it was found.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

// A light measured in its box. Gain, phase and mean are those of the whole box, as of tone_gain.
struct MeasuredLight {
  Region box;
  double frequency = 0;  // Hz; of data that of the strongest tone
  double swing = 1;      // relative to that in the frame in which the light was found
  double gain = 0, gain_std = 0;
  double phase = 0;  // rad in [−π, π], at the end of row 0's exposure
  double mean = 0;   // DN above dark
  Flags flags = 0;
};

// A light's tone in its box, all of whose columns are pooled; the view holds one frame. frequency: Hz.
MeasuredLight box_gain(const AnyFramesView& frame, const Camera& camera, const Region& box, double frequency);

// Top left corner of a box, possibly outside of the frame.
struct Place {
  std::ptrdiff_t x = 0, y = 0;
};

// A light as it looked in the frame in which it was found. Its box is divided into 2 × 8 cells. A box of this size
// shows the light if
//   * the mean of no cell, relative to that of the box, differs by more than a tenth of the light's amplitude (and 4
//     standard errors),
//   * the box swings 0.7 to 1.4 times as much, and the phases of its halves differ as before.
// Its place is where the means agree best, to a pixel or a 32nd of its size. A light that sends data is recognised at
// the given places only.
class KnownLight {
 public:
  // `frequency`: Hz; `carries_data`: compare waveforms instead of tones. Throws for a box outside of the frame.
  KnownLight(const AnyFramesView& frame, const Camera& camera, const Region& box, double frequency, bool carries_data);

  // The light in a later frame, near the first of the places that shows it; absent if none does, or if the frame has
  // another shape or no light.
  [[nodiscard]] std::optional<MeasuredLight> find(const AnyFramesView& frame, std::span<const Place> places) const;

  // In the frame in which it was found.
  [[nodiscard]] const MeasuredLight& first() const;

 private:
  struct State;
  std::shared_ptr<const State> state_;
};

}  // namespace ocisac
