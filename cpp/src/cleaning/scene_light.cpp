#include "ocisac/cleaning/scene_light.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "cleaning/block_shares.hpp"
#include "cleaning/cleaned_picture.hpp"
#include "cleaning/merged_blocks.hpp"
#include "core/levels.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

constexpr double kLeftByChips = 0.125;  // chips on some columns that leave more are its lines
constexpr double kLeastShown = 1.5;  // cycles of a light in a frame that its rows show, whatever the picture's shades
constexpr std::size_t kLongestBlock = 16;  // rows
constexpr std::size_t kFlattestBlock = 4;  // columns over rows: wide ones blur oblique edges of the light
constexpr std::array<double, 2> kToes{1.0 / 32, 1.0 / 8};  // in order; values in between give nearly the same picture
constexpr double kLessLeft =
    0.6;  // max. ratio of the unexplained shares with and without toe; noise alone may give 0.64
constexpr double kDeepest = 0.98;

bool all_tones(std::span<const ColourLights> lights) {
  return std::ranges::all_of(lights, [](const ColourLights& frame) {
    return std::ranges::all_of(frame.of_colour, [&](std::size_t k) { return frame.lights[k].model == RowModel::tone; });
  });
}

// Light of each frame's rows, of one colour: (frames × rows).
Values rows_of(std::span<const ColourLights> lights, std::size_t colour) {
  Values rows;
  for (const ColourLights& frame : lights) {
    const Values& own = frame.of(colour).light;
    rows.insert(rows.end(), own.begin(), own.end());
  }
  return rows;
}

// Rows and columns of the blocks of a picture. Means of rows as far apart as those compared change as the rows of a
// tone do.
BlockShares blocks_in(const StoredScene& scene, bool of_tones, std::size_t lag) {
  const std::size_t pixels = scene.rows() * scene.columns(), most = of_tones ? lag : lag / 4;
  if (!of_tones && pixels <= kWholePixels) return {{}, 1, 1};
  const double each = std::max(static_cast<double>(pixels) / static_cast<double>(kEnoughPixels), 1.0);
  const auto square = static_cast<std::size_t>(std::nearbyint(std::sqrt(each)));
  const std::size_t rows = std::max<std::size_t>(1, std::min({most, kLongestBlock, square}));
  const auto wide = static_cast<std::size_t>(std::nearbyint(each / static_cast<double>(rows)));
  return {{}, rows, scene.merged() * blocks_of(std::min(wide, kFlattestBlock * rows), scene.merged())};
}

// The toe of the first frame under chips, which are additive in light only: the candidate with the best fit, or 0. The
// scene has it then.
double find_toe(StoredScene& scene) {
  const std::vector<std::size_t> alike = alike_colours(scene.colours_of(0)).front();
  const auto left = [&](double toe) {
    scene.set_toe(toe);
    return unexplained_by_chips(sum_of(scene.colours_of(0), alike).free());
  };
  const double without = left(0);
  double least = without, best = 0;
  for (const double toe : kToes) {
    const double now = left(toe);
    if (now >= least) break;
    best = toe;
    least = now;
  }
  scene.set_toe(least < kLessLeft * without ? best : 0);
  return scene.toe();
}

std::vector<ColourLights> lights_of(const StoredScene& scene, RowModel model) {
  std::vector<ColourLights> lights;
  for (std::size_t frame = 0; frame < scene.frames(); ++frame)
    lights.push_back(find_colour_lights(scene.colours_of(frame), model));
  return lights;
}

std::vector<std::vector<BandedPicture>> pictures_of(const StoredScene& scene) {
  std::vector<std::vector<BandedPicture>> frames;
  for (std::size_t frame = 0; frame < scene.frames(); ++frame) frames.push_back(scene.colours_of(frame));
  return frames;
}

// Slow light that is left after division by another light.
std::vector<SlowLight> slow_light_left(const StoredScene& scene, const SceneLight& light) {
  std::vector<std::vector<BandedPicture>> frames = pictures_of(scene);
  std::vector<Blocks> cleaned;
  cleaned.reserve(scene.frames() * scene.colours());
  for (std::size_t frame = 0; frame < frames.size(); ++frame)
    for (std::size_t colour = 0; colour < scene.colours(); ++colour) {
      const auto share_of = [&](std::size_t row, std::size_t column) {
        return share_at(light.shares[colour], row, column * scene.merged(), scene.columns());
      };
      BandedPicture& picture = frames[frame][colour];
      cleaned.push_back(without_light(picture, light.lights[frame].of(colour).light, share_of));
      picture = cleaned.back().picture();
    }
  return find_slow_lights(frames);
}

void tell_slow_bands(std::span<const SlowLight> slow, SceneLight& light) {
  for (std::size_t frame = 0; frame < slow.size(); ++frame) light.verdicts[frame].slow_bands = slow[frame].amplitude;
}

SceneLight with_shares(const StoredScene& scene, std::vector<ColourLights> lights) {
  SceneLight result{std::move(lights), {}, {}, {}, {}};
  result.shares = shares_of(scene, result.lights);
  for (std::size_t frame = 0; frame < scene.frames(); ++frame)
    result.verdicts.push_back(verdict_on(scene, frame, result.lights[frame], result.shares));
  return result;
}

// Why the lights of the frames' first colour are lines of the picture; empty where some have none. Tones may be taken
// for chips.
std::string objection_to_lines_of(std::span<const ColourLights> lights, const Camera& camera) {
  const ModelledLight* main = &lights.front().of(0);
  std::vector<Values> frames;
  for (const ColourLights& frame : lights) {
    const ModelledLight& own = frame.of(0);
    if (own.model == RowModel::rows) return {};
    if (own.model == RowModel::tone) main = &own;
    frames.push_back(own.light);
  }
  return objection_to_lines(frames, main->model, main->frequency, camera);
}

// The shares of the colours are alike but for a factor.
bool are_alike(std::span<const BlockShares> shares) {
  return std::ranges::all_of(shares, [&](const BlockShares& own) {
    for (std::size_t i = 0; i < own.share.size(); ++i)
      if (std::abs(own.share[i] * shares[0].share[0] - shares[0].share[i] * own.share[0]) > kEqual) return false;
    return true;
  });
}

}  // namespace

double SceneLight::full_level(std::size_t frame, std::size_t colour) const {
  const auto lift_of = [&](std::size_t k) { return lights[frame].of(k).full - 1; };
  const double own = shares[colour].share.front();
  if (!(own > 0) || !are_alike(shares)) return 1 + lift_of(colour);
  double least = HUGE_VAL;
  for (std::size_t k = 0; k < shares.size(); ++k) least = std::min(least, shares[k].share.front() * lift_of(k));
  return 1 + least / own;
}

void SceneLight::join(const SceneLight& other) {
  for (std::size_t frame = 0; frame < verdicts.size(); ++frame) {
    verdicts[frame].slow_bands = other.verdicts[frame].slow_bands;
    if (other.unchanged.empty()) verdicts[frame].texture_change += other.verdicts[frame].texture_change;
  }
}

SceneLight left_alone(const StoredScene& scene, std::string reason) {
  ModelledLight even;
  even.light.assign(scene.rows(), 1);
  const ColourLights lights{{even}, std::vector<std::size_t>(scene.colours())};
  return {std::vector<ColourLights>(scene.frames(), lights),
          std::vector<BlockShares>(scene.colours(), BlockShares{{0.0}, scene.rows(), scene.columns()}),
          std::vector<CleaningVerdict>(scene.frames()),
          std::move(reason),
          {}};
}

bool has_equal_rows(const StoredScene& scene) {
  for (std::size_t frame = 0; frame < scene.frames(); ++frame)
    for (std::size_t colour = 0; colour < scene.colours(); ++colour) {
      const BandedPicture picture = scene.picture(frame, colour);
      const auto next = picture.light.subspan(picture.columns);
      if (!std::equal(next.begin(), next.end(), picture.light.begin())) return false;
    }
  return true;
}

std::vector<BlockShares> shares_of(const StoredScene& scene, std::span<const ColourLights> lights) {
  const BlockShares block = blocks_in(scene, all_tones(lights), comparison_lag(rows_of(lights, 0), scene.rows()));
  std::vector<Blocks> pictures;
  std::vector<Values> rows;
  for (std::size_t colour = 0; colour < scene.colours(); ++colour) {
    Blocks all{0, 0, {}, {}};
    for (std::size_t frame = 0; frame < scene.frames(); ++frame) {
      const std::size_t width = block.block_columns / std::min(scene.merged(), block.block_columns);
      const Blocks one = block_means(scene.picture(frame, colour), block.block_rows, width);
      all.rows = one.rows;
      all.columns = one.columns;
      all.light.insert(all.light.end(), one.light.begin(), one.light.end());
      all.variance.insert(all.variance.end(), one.variance.begin(), one.variance.end());
    }
    pictures.push_back(std::move(all));
    rows.push_back(means_of_rows(rows_of(lights, colour), scene.rows(), block.block_rows));
  }
  std::vector<BandedPicture> colours;
  for (const Blocks& all : pictures)
    colours.push_back({all.light, all.variance, scene.frames(), all.rows, all.columns});
  std::vector<BlockShares> result;
  for (Values& share : colour_shares(colours, rows))
    result.push_back({std::move(share), block.block_rows, block.block_columns});
  return result;
}

CleaningVerdict verdict_on(const StoredScene& scene, std::size_t frame, const ColourLights& lights,
                           std::span<const BlockShares> shares) {
  std::vector<CleaningVerdict> verdicts;
  for (std::size_t colour = 0; colour < scene.colours(); ++colour) {
    const BlockShares& own = shares[colour];
    const BlockShares merged{own.share, own.block_rows, blocks_of(own.block_columns, scene.merged())};
    verdicts.push_back(judge_cleaning(scene.picture(frame, colour), lights.of(colour).light, merged));
  }
  return mean_verdict(verdicts);
}

SceneLight light_of_slow(const StoredScene& scene, std::vector<SlowLight> slow) {
  const std::size_t rows = scene.rows(), colours = scene.colours();
  Values depths(colours, kEqual);
  for (const SlowLight& frame : slow)
    for (std::size_t k = 0; k < colours; ++k) depths[k] = std::clamp(swing_of(frame.tones[k]), depths[k], kDeepest);
  SceneLight result;
  const SlowLight& last = slow.back();
  for (const double depth : depths) {
    result.shares.push_back({{depth}, rows, scene.columns()});
    if (last.shares.empty()) continue;
    result.shares.back() = {last.shares, last.course.cell_rows, last.course.cell_columns * scene.merged()};
    for (double& share : result.shares.back().share) share = std::min(share * depth, kDeepest);
  }
  for (std::size_t frame = 0; frame < slow.size(); ++frame) {
    ColourLights lights;
    for (std::size_t k = 0; k < colours; ++k) {
      const std::vector<SlowTone>& tones = slow[frame].tones[k];
      ModelledLight own{ocisac::light_of(tones, rows),
                        1,
                        RowModel::tone,
                        slow[frame].common.front().cycles / static_cast<double>(rows),
                        {}};
      for (double& value : own.light) value = std::max(1 + (value - 1) / depths[k], 0.0);
      own.full = 1 + swing_of(tones) / depths[k];
      lights.of_colour.push_back(k);
      lights.lights.push_back(std::move(own));
    }
    CleaningVerdict verdict = verdict_on(scene, frame, lights, result.shares);
    verdict.light_left = slow[frame].verdict.left;
    verdict.level = slow[frame].verdict.level;
    result.verdicts.push_back(verdict);
    result.lights.push_back(std::move(lights));
  }
  result.slow = std::move(slow);
  // A light of other frames, or of another frequency. Below that a shade of the picture may hide the light.
  if (result.slow.back().common.front().cycles > kLeastShown && mean_verdict(result.verdicts).gain < 0)
    result.unchanged = kWouldGrow;
  return result;
}

SceneLight find_scene_light(StoredScene& scene, const Camera& camera, RowModel model, bool toe_is_known,
                            std::span<const ColourLights> given, const EarlierFrames& earlier,
                            const std::string& no_other) {
  if (given.empty() && has_equal_rows(scene)) return left_alone(scene, objection_to(CleaningVerdict{}));
  std::vector<SlowLight> slow;
  if (given.empty() && (model == RowModel::automatic || model == RowModel::tone || model == RowModel::slow))
    slow = find_slow_lights(pictures_of(scene), earlier);
  std::optional<SceneLight> slow_found;
  if (!slow.empty() && std::ranges::all_of(slow, [](const SlowLight& own) { return own.objection.empty(); }))
    slow_found = light_of_slow(scene, slow);
  if (slow_found && !slow_found->unchanged.empty()) slow_found.reset();
  // The shares of faster tones vary with the place where pairs of rows show it.
  if (slow_found && slow.front().common.front().cycles * kSlowestRows < static_cast<double>(scene.rows()))
    return *std::move(slow_found);
  const auto none_but = [&](const std::string& reason) {
    SceneLight found = left_alone(scene, reason);
    tell_slow_bands(slow, found);
    found.slow = std::move(slow);
    return found;
  };
  if (model == RowModel::slow && slow_found) return *std::move(slow_found);
  if (model == RowModel::slow) return none_but(slow.front().objection.empty() ? kWouldGrow : slow.front().objection);
  if (!no_other.empty() && !slow_found) return none_but(no_other);
  std::vector<ColourLights> lights =
      given.empty() ? lights_of(scene, model) : std::vector<ColourLights>(given.begin(), given.end());
  const bool is_curved = camera.tone_curve.kind != ToneCurve::Kind::linear;
  if (!toe_is_known && is_curved && lights.front().of(0).model == RowModel::chips) {
    if (find_toe(scene) > 0) lights = lights_of(scene, RowModel::chips);
  }
  const RowModel main = lights.front().of(0).model;
  if (model == RowModel::automatic && main == RowModel::rows && !slow_found && given.empty())
    return none_but("no tone and no chips: the rows may be the picture's own");
  SceneLight found = with_shares(scene, std::move(lights));
  const CleaningVerdict mean = mean_verdict(found.verdicts);
  if (given.empty()) found.unchanged = objection_to(mean);
  const bool are_lines = mean.light_left > kLeftByChips && mean.level < kMostly;
  if (found.unchanged.empty() && model == RowModel::automatic && main == RowModel::chips && are_lines)
    found.unchanged = "chips that explain the rows in part";
  if (found.unchanged.empty() && model == RowModel::automatic && given.empty())
    found.unchanged = objection_to_lines_of(found.lights, camera);
  if (slow_found) {
    const bool is_even = main == RowModel::tone && std::ranges::all_of(found.shares, &BlockShares::is_one);
    const bool explains_more = mean_verdict(slow_found->verdicts).gain >= mean.gain;
    if (!found.unchanged.empty() || main == RowModel::rows || (is_even && explains_more)) return *std::move(slow_found);
  }
  if (!slow.empty() && !found.unchanged.empty()) {
    const auto seen = std::find_if(slow.begin(), slow.end(), [](const SlowLight& own) { return own.amplitude > 0; });
    if (seen != slow.end()) found.unchanged = seen->objection;
    tell_slow_bands(slow, found);
    found.slow = std::move(slow);
    return found;
  }
  tell_slow_bands(slow_light_left(scene, found), found);
  return found;
}

}  // namespace ocisac
