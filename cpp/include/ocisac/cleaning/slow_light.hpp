// A row light slower than 128 rows per cycle: mains at a few cycles a picture.
//
// All pixels of a row have the light in common, and so they have part of the picture: horizons, shades, vignettes. The
// cosine modes of the course that the columns have in common tell them apart. Those of a picture decrease with their
// order k as k^-1.5, by a factor S that is the picture's own; the logarithm of a light that varies as a sine stands out
// of them. Where frames follow each other, the picture stays, and the phase advances by the same step.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "ocisac/cleaning/light_share.hpp"

namespace ocisac {

constexpr std::size_t kMostSlowFrames = 8;  // that are compared, missing ones counted
constexpr const char* kWouldGrow = "slow bands: the rows would differ more than before";

// Cosine modes 1 to K of the log light that the columns of a picture have in common.
struct CommonCourse {
  std::vector<double> modes;
  std::vector<double> variance;             // of what the groups of columns have not in common
  std::vector<std::vector<double>> groups;  // the modes of each group of columns
  std::ptrdiff_t place = 0;                 // number of the frame, missing ones counted
  std::vector<double> cells = {};           // logarithm of the mean light of some 16 × 16 parts of the picture
  std::size_t cell_rows = 1, cell_columns = 1;
};

// Differences of blocks of pixels along the rows are fitted with a redescending weight, since edges are few. `of_all`:
// for one of several colours the course of all of them, from which its own starts and whose variance it has.
CommonCourse common_course(std::span<const BandedPicture> colours, const CommonCourse* of_all = nullptr);

// Number of modes: those up to one and a half times the fastest slow tone.
std::size_t mode_count(std::size_t rows);

// A tone of the light of the rows, 1 + a·cos θ + b·sin θ; θ: 2π·cycles·(place − ½) + step·frame.
struct SlowTone {
  double cycles = 0;                 // in the picture
  std::optional<double> step;        // advance of its phase from frame to frame, rad; none: a single frame shows none
  std::array<double, 2> terms{};     // a and b
  std::array<double, 2> variance{};  // of each
  double log_odds = 0;               // natural logarithm of the odds of the tone against none

  [[nodiscard]] double amplitude() const;  // relative to the mean light
  // The evidence is enough to remove it: the rest is smaller than the tone, and there is a tone.
  [[nodiscard]] bool is_sure() const;
  [[nodiscard]] SlowTone in_frame(std::ptrdiff_t frame) const;  // with its phase in a later frame, if step is known
};

// Light of the rows under some tones: their mean over a cycle is 1.
std::vector<double> light_of(std::span<const SlowTone> tones, std::size_t rows);

// Sum of the amplitudes; the light is between 1 less this, but 0.02 or more, and 1 more.
double swing_of(std::span<const SlowTone> tones);

// Agreement of the groups of columns about slow tones.
struct SlowVerdict {
  double left = 0;   // swing of the tone in the groups after its removal, over that before
  double worse = 0;  // share of the groups whose tone grows
  double level = 1;  // coherence of the groups' tones, 1 for level bands of one depth, 0 for tilted ones
};

// Slow light of one frame.
struct SlowLight {
  std::vector<std::vector<SlowTone>> tones;  // of each colour: the same ones, of other terms
  std::vector<SlowTone> common;              // those of all colours
  CommonCourse course;                       // of all colours, which following frames are compared with
  double left = 0;                           // share of what differs between the compared frames that the tones leave
  double amplitude = 0;                      // of the strongest tone, relative to the light; 0 where none is likely
  SlowVerdict verdict;
  std::string objection;            // why it is not removed, or empty
  std::vector<double> shares = {};  // of the light in the course's cells, relative to the tones; empty: 1
  bool is_first = false;            // earlier frames, which it disagrees with, are not compared
};

// Frames before others.
struct EarlierFrames {
  std::vector<CommonCourse> courses;
  std::ptrdiff_t next = 0;  // the place of the first of the others
};

// Finds the slow light of each of consecutive frames of one scene. `frames`: of each frame, the pictures of its
// colours. `near`: the tones of the last of the earlier frames, if they are known.
// Frames whose own course disagrees with the tone of earlier ones are compared without them.
std::vector<SlowLight> find_slow_lights(std::span<const std::vector<BandedPicture>> frames,
                                        const EarlierFrames& earlier = {}, std::span<const SlowTone> near = {});

// The slow light of a frame `ago` frames before one of known light; `colours`: its pictures. It has an objection where
// the two frames do not differ less without it, but for chance.
SlowLight slow_light_before(const std::vector<BandedPicture>& colours, const SlowLight& later, std::ptrdiff_t ago);

}  // namespace ocisac
