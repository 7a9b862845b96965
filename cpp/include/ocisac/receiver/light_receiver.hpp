// One light tracked from frame to frame: its columns, gain, data and best exposure.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/core/flags.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/exposure/best_exposure.hpp"
#include "ocisac/receiver/chip_receiver.hpp"
#include "ocisac/tones/tone_gain.hpp"

namespace ocisac {

struct GainOptions {
  std::optional<double> frequency;  // Hz of the tone; absent: estimated once the light is found
  WaveformShape waveform = WaveformShape::tone;
  double duty = 0.5;      // of a square wave
  double background = 0;  // light of other sources, DN above dark
};

// Quantities to receive from each light.
struct LightOptions {
  std::optional<ChipOptions> data = ChipOptions{};  // absent: no data
  std::optional<GainOptions> gain{};                // absent: no gain
  std::optional<double> sense_frequency{};          // Hz f_s, for the joint optimum of eq. 18
};

// Unknown numbers are NaN.
struct LightGain {
  double frequency, frequency_std;          // Hz; no standard error for a given frequency
  double gain, gain_std, phase, mean, snr;  // as of tone_gain
  Flags flags = 0;
};

struct LightFrame {
  std::int64_t frame = 0;
  std::size_t source = 0;                  // index of the light in order of detection, from 0
  bool searched = false;                   // lights were searched in this frame
  Region region;                           // region in which the light was received
  std::optional<ReceivedFrame> received;   // if requested or the frame was skipped; phase: row of the picture
  std::optional<LightGain> gain;           // if requested
  std::optional<BestExposure> suggestion;  // best exposure for the light; absent while no frequency is known
};

// Weights of the colours of one lamp: their sum shows one stream of chips and no other one.
struct ColourWeights {
  std::vector<double> weights;  // empty: the colour of best quality alone
  std::size_t colour = 0;       // that shows the stream best
};

class LightReceiver {
 public:
  // Throws std::invalid_argument.
  LightReceiver(const Camera& camera, const LightOptions& options, std::size_t source);
  LightReceiver(LightReceiver&&) = default;
  LightReceiver& operator=(LightReceiver&&) = default;

  // Sets the light's region from the next frame on. `can_move`: the region tracks the light across columns.
  void place(const Region& region, bool can_move);

  // Resets all state of earlier frames; the packet keeps its bytes.
  void forget();

  // `colours`: a frame, one view per colour; the colour of best quality is received until three frames agree on the
  // streams that the colours send: then the sum of all that shows one of them. `free`: rows about the region
  // without another light in its columns. A light that can move is received in all of them: dark rows at either end
  // show where it ends, better than the region.
  LightFrame push(std::span<const AnyFramesView> colours, std::int64_t frame, RowRange free, const FrameStamp& stamp);

  // The other streams of the lamp, once; each is for a receiver of its own.
  [[nodiscard]] std::vector<ColourWeights> take_other_streams() { return std::exchange(other_streams_, {}); }

  // Receives this stream alone.
  void receive_stream(ColourWeights stream);
  [[nodiscard]] bool can_move() const { return can_move_; }
  [[nodiscard]] bool is_other_stream() const { return is_other_stream_; }

  [[nodiscard]] const Region& region() const { return region_; }
  [[nodiscard]] std::size_t unseen() const { return unseen_; }  // frames since the last data or tone

 private:
  std::size_t receive_data(std::span<const AnyFramesView> colours, RowRange free, const FrameStamp& stamp,
                           LightFrame& result);
  void learn_streams(const std::vector<CombinedColumn>& columns, const ReceivedFrame& received, std::size_t first_row);
  void forget_streams();
  void follow(const CombinedColumn& column, std::size_t columns);
  void find_tone(const AnyFramesView& part);
  [[nodiscard]] LightGain measure_gain(const AnyFramesView& part) const;
  void suggest_exposure(const LightFrame& result);

  Camera camera_;
  LightOptions options_;
  std::size_t source_;
  std::optional<ChipReceiver> chips_;
  Region region_;
  bool can_move_ = false;
  std::vector<ColumnFollower> followers_;  // one per colour
  ColourWeights stream_;                   // that is received
  std::vector<ColourWeights> proposed_;    // by the last frames, that of this receiver first
  std::size_t agreed_ = 0;                 // frames that agree on them
  std::vector<ColourWeights> other_streams_;
  bool is_other_stream_ = false;
  bool tone_known_ = false;  // frequency_ belongs to this region
  double frequency_, frequency_std_;
  Flags frequency_flags_ = 0;
  double suggested_for_ = 0;  // Hz, 0: none yet
  std::optional<BestExposure> suggestion_;
  std::size_t unseen_ = 0;
};

}  // namespace ocisac
