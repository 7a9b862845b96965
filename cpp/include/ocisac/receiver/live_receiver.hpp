// What a device beside a camera runs: a light found once and followed, its gain and its data frame by frame.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "ocisac/camera/camera.hpp"
#include "ocisac/columns/column_follower.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/exposure/best_exposure.hpp"
#include "ocisac/receiver/stream_receiver.hpp"
#include "ocisac/tones/tone_gain.hpp"

namespace ocisac {

struct LiveOptions {
  bool gain = true, data = true;          // what is wanted
  std::optional<Region> region;           // where the light is; absent: searched
  std::optional<double> frequency;        // Hz of the tone; absent: found with the light
  std::optional<double> chip_rate;        // Hz, good to 2 %; absent: found blind
  std::optional<double> sense_frequency;  // Hz f_s, for the exposure that serves both (eq. 18)
  WaveformShape waveform = WaveformShape::tone;
  double duty = 0.5;      // of a square wave
  double background = 0;  // light that is not the source's, DN above dark
  PacketFormat format{};
};

// Numbers that are not known are NaN.
struct LiveGain {
  double frequency, frequency_std;          // Hz; no standard error where it was told
  double gain, gain_std, phase, mean, snr;  // as of tone_gain
  Flags flags = 0;
};

struct LiveFrame {
  std::int64_t frame = 0;
  bool searched = false;                   // the light was looked for in the whole picture
  Region region;                           // that was read
  std::optional<LiveGain> gain;            // where wanted
  std::optional<ReceivedFrame> received;   // where wanted
  std::optional<BestExposure> suggestion;  // of the exposure; absent while no frequency is known
};

// The strongest light of a stream of frames. It is looked for in the first frame; where it was not seen in several
// frames one after the other, it is looked for again, ever more seldom while there is none. Memory is bounded.
class LiveReceiver {
 public:
  LiveReceiver(const Camera& camera, LiveOptions options);

  // `frame`: one picture, rows in time order; `number`: ascending. All frames of one shape and type.
  const LiveFrame& push(const AnyFramesView& frame, std::int64_t number);

 private:
  void search(const AnyFramesView& frame);
  void find_tone(const AnyFramesView& part);
  void measure_gain(const AnyFramesView& part);
  void read_data(const AnyFramesView& part);
  void suggest_exposure();
  [[nodiscard]] bool seen() const;

  Camera camera_;
  LiveOptions options_;
  ColumnFollower follower_;
  std::optional<Receiver> receiver_;
  std::array<std::size_t, 3> kind_{};  // rows, columns and type of the first frame
  Region region_;
  bool found_ = false;  // region_ is a light's; else the whole picture is read meanwhile
  double frequency_, frequency_std_;
  Flags frequency_flags_ = 0;
  double suggested_for_ = 0;  // Hz of the light, 0: none yet
  std::size_t unseen_ = 0;    // frames since the light was seen or searched
  std::size_t patience_;      // frames unseen before it is searched again
  LiveFrame result_;
};

}  // namespace ocisac
