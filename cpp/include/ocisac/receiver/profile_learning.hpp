// The recent frames of a light, and the lamp's profile along the rows where single frames fit no model.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/chips/row_profile.hpp"
#include "ocisac/columns/column_combination.hpp"
#include "ocisac/receiver/row_model_search.hpp"

namespace ocisac {

// The lamp's profile, the rows in which it is bright enough, and what it leaves of the frames, relative to the swing.
struct LearnedProfile {
  RowProfile profile;
  RowRange rows;
  double noise = 0;
  bool fits = false;    // no more than noise
  bool beside = false;  // other lamps' light is as bright where the lamp is dark: no part of its profile
};

// A recent frame: its rows, and s of each where its chips are known.
struct KeptFrame {
  std::int64_t number;
  double time;  // on the tracker's clock, in frames
  std::vector<double> signal, exposed;
  std::vector<double> lamp;  // the signal less slow light and tones beside the chips
  bool bright = false;       // its columns show a common light
  bool seen = false;         // chips were detected
  bool fits = false;         // no more than noise is left
  bool sure = false;         // more is, too little to put a chip in doubt
  bool counted = false;      // its place in the stream is stated
  bool repeats = false;      // found to be the frame before it, given twice
  double noise = 1;          // that is left, relative to the swing

  // `reading`: of the rows less the profile.
  void expose(const FrameReading& reading, const LearnedProfile& learned, const RowNuisance& nuisance);
};

class ProfileLearning {
 public:
  // A kept frame that was read again, and its rows less the profile; true where it repeats the frame before it.
  using UseReading = std::function<bool(const KeptFrame&, const FrameReading&, std::span<const double>)>;

  // Adds the current frame. `counted`: its place in the stream is stated. `first_row`: of the picture, at index 0 of
  // the signal.
  void keep(const CombinedColumn& column, std::int64_t frame, double time, bool counted, std::size_t first_row);
  // Removes the current frame: it repeats the last one.
  void drop_last() { kept_.pop_back(); }
  void forget();

  // In use.
  [[nodiscard]] const std::optional<LearnedProfile>& profile() const { return profile_; }
  // True while a profile is learned or used. `can_move`: the light need not stay where it is, which only a doubt about
  // its chips is worth.
  [[nodiscard]] bool compares_rows(bool can_move) const;
  // Kept frames; those that fit no model and leave chips in doubt; whether these are all.
  [[nodiscard]] std::size_t size() const { return kept_.size(); }
  [[nodiscard]] std::size_t doubtful() const;
  [[nodiscard]] bool all_doubtful() const { return doubtful() == kept_.size(); }
  // These rows of all kept frames.
  [[nodiscard]] std::vector<std::span<const double>> rows_of_all(std::size_t first_row, std::size_t rows) const;

  // Refits the profile to the current frame's reading from time to time. False where the profile explains the frames no
  // longer: it is dropped, and the clock restarts.
  bool follow(const std::optional<FrameReading>& reading, RowModelSearch& rows);

  // True where most frames fit no model, with growing pauses; where their chips are sure, only without a profile and a
  // few times. Once per frame.
  bool comes_due();
  // Drops frames that were given again: these have their times, and later ones are as much earlier. Returns the number.
  std::int64_t drop_given_again();
  // Learns a profile from enough frames; true where there is one now.
  bool learn_first(RowModelSearch& rows, const CombinedColumn& column, std::size_t first_row);

  // Reads the kept frames again, less the profile in use, from a new clock on.
  void read_again(RowModelSearch& rows, const CombinedColumn& column, std::size_t first_row, const UseReading& use);
  // The same without a profile, in the `lit` rows.
  void read_again(RowModelSearch& rows, const CombinedColumn& column, std::size_t first_row, RowRange lit,
                  const UseReading& use);

 private:
  struct KeptFit {
    std::size_t frames = 0, read = 0;  // that leave no more than noise; that were read
    double noise = 0;                  // mean over the frames, relative to the swing
  };
  struct Start {
    LearnedProfile learned;
    std::vector<double> tones;  // cycles per row
  };
  [[nodiscard]] std::vector<ProfileFrame> frames() const;
  KeptFit read_kept(RowModelSearch& rows, const LearnedProfile& learned, const CombinedColumn& column,
                    std::size_t first_row, const UseReading& use);
  void drop_repeated();
  [[nodiscard]] std::vector<std::vector<double>> changes() const;
  [[nodiscard]] std::optional<LearnedProfile> first_learned(std::size_t smooth, const RowNuisance& beside) const;
  [[nodiscard]] std::vector<double> divided(const LearnedProfile& learned) const;
  [[nodiscard]] std::vector<Start> starts(const RowModelSearch& rows) const;
  bool finds_tone_left(LearnedProfile& learned, RowModelSearch& rows) const;
  [[nodiscard]] bool is_worth(const LearnedProfile& learned) const;
  std::optional<LearnedProfile> learn(RowModelSearch& rows, const CombinedColumn& column, std::size_t first_row,
                                      const Start& start);

  std::deque<KeptFrame> kept_;                    // the last frames, the current one included
  std::size_t kept_first_row_ = 0;                // of the picture, at index 0 of their signals
  std::optional<LearnedProfile> profile_;         // where single frames fit no model
  std::size_t attempts_ = 0, until_attempt_ = 0;  // in vain; frames until the next
  std::size_t profile_misfits_ = 0;               // consecutive frames that the profile does not explain
};

}  // namespace ocisac
