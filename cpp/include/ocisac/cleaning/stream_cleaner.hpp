// Removal of bands from the frames of a video: light and shares are carried from frame to frame.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/cleaning/scene_light.hpp"
#include "ocisac/cleaning/stored_scene.hpp"

namespace ocisac {

struct StreamOptions {
  RowModel model = RowModel::automatic;
  std::optional<double> noise;  // standard deviation of a pixel, DN; absent: estimated
  std::optional<double> toe;    // of the tone curve, 0 to 1; absent: estimated
};

// The first frame is cleaned as a picture. In the following ones a tone keeps its frequency, which becomes more precise
// from frame to frame, and gets its phase from the frame; other lights are found in each frame. Shares move with the
// picture, and become the mean of several estimates. A slow tone is compared with up to 7 frames before, in which the
// picture stays and the phase advances, and is left until the third frame of a stream; time stamps tell how many frames
// are missing among them. A frame for which that fails, such as the first of another scene, is cleaned as a picture
// again. In a film without a light the first eight frames and three of every 32 are searched for slow lights, and those
// after 0, 1, 2, 4, 8, … frames and two of every 32 for others; after a light all of the next eight are searched for
// both.
class StreamCleaner {
 public:
  struct Frame {
    StoredScene stored;
    SceneLight light;
  };

  explicit StreamCleaner(const Camera& camera, const StreamOptions& options = {});

  // Estimates the light of the next frame. `colours`: one view each, of one frame; their memory must outlive the
  // result. `time`: s.
  Frame push(std::vector<AnyFramesView> colours, std::optional<double> time = {});

  // A frame `ago` frames before the last one, which was left as it is, under the slow light or as the
  // chips that have been found since.
  [[nodiscard]] Frame again(const std::vector<AnyFramesView>& colours, std::size_t ago) const;

  void forget();  // cleans the next frame as a picture

 private:
  // The frame before: lights and shares of the colours, its picture, and what the estimates consist of.
  struct Before {
    ColourLights lights;
    std::vector<BlockShares> shares;
    Blocks guide;                   // logarithm of the cleaned picture, in large blocks
    std::size_t columns;            // of the camera
    double toe, slow_bands;         // in the last frame that was cleaned alone
    std::size_t frames;             // since the first
    std::vector<double> estimates;  // number of them in each block's share
  };

  std::optional<double> frames_since_last(std::optional<double> time);
  void leave_room(double missing);
  // Why the light of a frame's rows is the picture's, or may be; empty: it is none. The next frame's is compared with
  // it.
  [[nodiscard]] std::string objection_to_lines(const ModelledLight& light);
  void forget_slow();
  [[nodiscard]] bool compares_with(std::size_t rows) const;
  std::optional<Frame> followed(const std::vector<AnyFramesView>& colours);
  std::optional<Frame> slowly(const std::vector<AnyFramesView>& colours);
  Frame alone(const std::vector<AnyFramesView>& colours, const std::string& no_other);
  void await_slow(Frame& first) const;
  void keep_slow(const SceneLight& light);
  ColourLights followed_lights(const StoredScene& stored) const;

  Camera camera_;
  StreamOptions options_;
  std::optional<Before> before_;
  EarlierFrames earlier_;                    // while no other light is found
  std::vector<double> lines_;                // light of the rows of the last frame that may be lines of the picture
  double moving_ = 0;                        // cycles per row of a tone whose phase advanced; 0: none
  std::optional<SlowLight> slow_;            // of the frame before, where it is removed
  std::size_t unlit_ = 0;                    // frames without a light since the last one with it
  bool was_lit_ = false;                     // some frame had a light
  std::optional<double> noise_;              // of the last frame that was searched
  std::string unchanged_;                    // why the last frame that was searched is
  std::optional<double> time_, frame_time_;  // of the last frame, and from frame to frame, s
  double frames_ = 0;                        // that frame_time_ is the mean of, where the camera's is unknown
};

}  // namespace ocisac
