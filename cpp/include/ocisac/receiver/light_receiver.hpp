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
#include "ocisac/core/constants.hpp"
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
  double frequency = kNaN, frequency_std = kNaN;  // Hz; no standard error for a given frequency
  double gain = kNaN, gain_std = kNaN, phase = kNaN, mean = kNaN, snr = kNaN;  // as of tone_gain
  Flags flags = 0;
};

struct LightFrame {
  std::int64_t frame = 0;
  std::size_t source = 0;                    // index of the light in order of detection, from 0
  bool searched = false;                     // lights were searched in this frame
  Region region{};                           // region in which the light was received
  std::optional<ReceivedFrame> received{};   // if requested or the frame was skipped; phase: row of the picture
  std::optional<LightGain> gain{};           // if requested
  std::optional<BestExposure> suggestion{};  // best exposure for the light; absent while no frequency is known
};

// A stream of chips that the colours of one lamp send, or the opposite of one.
struct ColourStream {
  std::vector<double> weights{};  // of the colours' signals: their sum follows this stream and no other one
  std::size_t colour = 0;         // the colour that shows it best, in whose swing the sum is scaled
};

// A light's columns in one frame.
struct LightColumns {
  std::vector<CombinedColumn> of_colour{};
  CombinedColumn best{};              // that is received
  std::size_t colour = 0;             // that shows it best
  RowRange rows{0, 0}, region{0, 0};  // of the picture; those of them in which the light was found
  bool held = false;                  // weighted as those of the frame before
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

  // The light's columns combined, of each colour. `colours`: a frame, one view per colour. `free`: rows about the
  // region without another light in its columns; a light that can move is received in all of them: dark rows at either
  // end show where it ends, better than the region.
  LightColumns combine(std::span<const AnyFramesView> colours, RowRange free);

  // Receives the signal's chips; absent: no data is wanted.
  [[nodiscard]] ChipReceiver* chips() { return chips_ ? &*chips_ : nullptr; }

  // The result of a frame. `received`: of the columns' signal. Three frames that agree on the streams of the lamp's
  // colours decide them. The region moves with the light, and its tone is measured.
  LightFrame finish(std::span<const AnyFramesView> colours, const LightColumns& seen,
                    std::optional<ReceivedFrame> received, std::int64_t frame);

  // The other streams of the lamp, once; each is for a receiver of its own.
  [[nodiscard]] std::vector<ColourStream> take_other_streams() { return std::exchange(other_streams_, {}); }

  // Receives this stream alone.
  void receive_stream(ColourStream stream);
  [[nodiscard]] bool can_move() const { return can_move_; }
  [[nodiscard]] bool is_other_stream() const { return is_other_stream_; }

  [[nodiscard]] const Region& region() const { return region_; }
  [[nodiscard]] std::size_t unseen() const { return unseen_; }  // frames since the last data or tone
  [[nodiscard]] bool is_lost() const { return unseen_ >= kLost; }

  static constexpr std::size_t kLost = 8;          // frames without the light
  static constexpr std::size_t kFramesAgreed = 3;  // consecutive frames that agree on lights or streams

 private:
  void learn_streams(const std::vector<CombinedColumn>& columns, const ReceivedFrame& received, std::size_t first_row);
  void forget_columns();
  void forget_streams();
  void follow(const CombinedColumn& column, std::size_t columns);
  void find_tone(const AnyFramesView& part);
  [[nodiscard]] LightGain measure_gain(const AnyFramesView& part) const;
  void suggest_exposure(const std::optional<ReceivedFrame>& received);

  Camera camera_;
  LightOptions options_;
  std::size_t source_;
  std::optional<ChipReceiver> chips_;
  Region region_;
  bool can_move_ = false;
  std::vector<ColumnFollower> followers_;  // one per colour
  ColourStream stream_;                    // that is received; no weights: the colour of best quality
  std::vector<ColourStream> proposed_;     // by the last frames, that of this receiver first
  std::size_t agreed_ = 0;                 // frames that agree on them
  std::vector<ColourStream> other_streams_;
  bool is_other_stream_ = false;
  bool tone_known_ = false;   // tone_ belongs to this region
  LightGain tone_;            // its frequency
  double suggested_for_ = 0;  // Hz, 0: none yet
  std::optional<BestExposure> suggestion_;
  std::size_t unseen_ = 0;
};

}  // namespace ocisac
