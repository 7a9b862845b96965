// The recent frames of a light, and the lamp's profile along the rows where single frames fit no model.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/row_profile.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/receiver/row_reader.hpp"

namespace ocisac {

// The lamp's profile, the rows in which it is bright enough, and what it leaves of the frames, relative to the swing.
struct LearnedProfile {
  RowProfile profile;
  RowRange rows;
  double noise = 0;
  bool fits = false;    // no more than noise
  bool beside = false;  // other lamps' light is as bright where the lamp is dark: no part of its profile
  bool plain = false;   // the rows alone, as they are
};

// A recent frame: its rows, and s of each where its chips are known.
struct KeptFrame {
  std::int64_t number;
  double time;  // on the tracker's clock, in frames
  std::vector<double> signal, exposed{};
  std::vector<double> before{};  // the signal of the frame before; empty: none
  std::vector<double> lamp{};    // the signal less slow light and tones beside the chips
  std::vector<double> level{};   // (rows) of the still light in its reading, over the swing: daylight changes it
  bool bright = false;           // its columns show a common light
  bool counted = false;          // its place in the stream is stated
  bool repeats = false;          // the frame before it, given twice
  std::optional<Trust> trust{};  // in its reading; absent: no chips
  double noise = 1;              // that is left, relative to the swing

  // `reading`: of the rows less the profile.
  void expose(const FrameReading& reading, const LearnedProfile& learned);
};

// The last frames of a light, the current one last, and what was learned from them.
struct FrameHistory {
  std::deque<KeptFrame> frames{};
  std::size_t first_row = 0;                                   // of the picture, at index 0 of their signals
  std::optional<LearnedProfile> profile{};                     // in use, where single frames fit no model
  BackOff attempts{.shortest = 2, .longest = 32, .quick = 4};  // to learn one
  std::size_t unexplained = 0;                                 // consecutive frames that the profile does not explain

  // Adds the current frame; `now.signal` from row `first_row_of_now` of the picture on.
  void keep(KeptFrame now, std::size_t first_row_of_now);
  // Removes frames that are found to be given twice.
  void drop_repeated();
  // Marks and removes frames that were given again: these have their times, and later ones are as much earlier.
  // Returns the number.
  std::int64_t drop_given_again();

  // Removes the frame before the current one where it is the mean of its neighbours, as a film of another frame rate
  // has them between its frames. Returns its number where no chips were read in it.
  std::optional<std::int64_t> drop_mean();

  // True while a profile is learned or used: the next frame's columns should be weighted as the last one's.
  // `can_move`: the light need not stay where it is, which only a doubt about its chips is worth.
  [[nodiscard]] bool compares_rows(bool can_move) const;
  // Frames that fit no model and leave chips in doubt.
  [[nodiscard]] std::size_t doubtful() const;
  // These rows of all frames.
  [[nodiscard]] std::vector<std::span<const double>> rows_of_all(std::size_t begin, std::size_t rows) const;
  [[nodiscard]] bool is_long_enough() const { return frames.size() >= kMinFrames; }
  // True where most frames fit no model and leave chips in doubt, with growing pauses. Once per frame.
  bool comes_due();

  static constexpr std::size_t kMinFrames = 8;  // to learn from
};

// Those rows of the frame before, of mean 0, less a profile; empty: none.
std::vector<double> rows_before(const KeptFrame& kept, const std::optional<LearnedProfile>& learned, RowRange rows);

// A kept frame read again with the state's model, less a profile. `rows`: its rows, when it was read, and the effort.
std::optional<FrameReading> read_kept(const RowReader& reader, const LearnedProfile& learned, const LightState& state,
                                      std::size_t first_row, KeptFrame& kept, FrameRows& rows);

// A profile, the frames that it was learned from, and the state with their model.
struct Learned {
  LearnedProfile profile;
  std::deque<KeptFrame> frames;
  LightState state;
  double searches = FrameHistory::kMinFrames;  // frames' efforts left
};

// Learns a profile from enough frames. Absent where none explains them, and none better than that in use.
std::optional<Learned> learn_profile(const RowReader& reader, const FrameHistory& history, const LightState& state);

// The state before the frames are read again, less a profile: levels of 0 and 1, and of the clock all but its phase.
LightState with_new_phase(LightState state);

// Refits the profile in use to the current frame's reading from time to time. False where it explains the frames no
// longer.
bool follow_profile(const RowReader& reader, const std::optional<FrameReading>& reading, FrameHistory& history,
                    LightState& state);

}  // namespace ocisac
