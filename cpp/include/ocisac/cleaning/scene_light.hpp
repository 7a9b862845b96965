// The light of the rows in frames of one scene, its shares, and whether cleaning with them would better the picture.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/cleaning/judge_cleaning.hpp"
#include "ocisac/cleaning/row_model.hpp"
#include "ocisac/cleaning/slow_light.hpp"
#include "ocisac/cleaning/stored_scene.hpp"

namespace ocisac {

struct SceneLight {
  std::vector<ColourLights> lights;       // of each frame
  std::vector<BlockShares> shares;        // of each colour
  std::vector<CleaningVerdict> verdicts;  // on each frame
  std::string unchanged;                  // why the frames are better left as they are; else empty
  std::vector<SlowLight> slow;            // of each frame; empty where another light is removed or given

  // A light is removed that leaves slow ones.
  [[nodiscard]] bool may_leave_slow() const { return unchanged.empty() && slow.empty(); }
  // Verdicts on the frames without this light and another one that was searched in what it leaves.
  void join(const SceneLight& other);

  // Full light of a colour, relative to the mean light of its row light. Where the shares of the colours are alike,
  // that which lifts pixels by one factor: that of the colour whose light varies least, so that the picture keeps its
  // colours.
  [[nodiscard]] double full_level(std::size_t frame, std::size_t colour) const;
};

// Estimates the light. `scene`: its toe is set to the one found, unless `toe_is_known`. `given`: the light of each
// frame, which is not searched then; empty: none. `no_other`: why faster lights are searched only beside a slow one.
SceneLight find_scene_light(StoredScene& scene, const Camera& camera, RowModel model, bool toe_is_known,
                            std::span<const ColourLights> given = {}, const EarlierFrames& earlier = {},
                            const std::string& no_other = {});

// The frames stay as they are, for a reason.
SceneLight left_alone(const StoredScene& scene, std::string reason);

// The rows of every picture are equal, as in a black one: there is nothing to remove.
bool has_equal_rows(const StoredScene& scene);

// A slow light, of which all pixels have the same share.
SceneLight light_of_slow(const StoredScene& scene, std::vector<SlowLight> slow);

// The share of each colour's row light in blocks of pixels; `lights`: of each frame.
std::vector<BlockShares> shares_of(const StoredScene& scene, std::span<const ColourLights> lights);

// The mean verdict on the colours of one frame.
CleaningVerdict verdict_on(const StoredScene& scene, std::size_t frame, const ColourLights& lights,
                           std::span<const BlockShares> shares);

}  // namespace ocisac
