#include "ocisac/cleaning/row_model.hpp"

#include <algorithm>
#include <cmath>

#include "cleaning/quantile.hpp"
#include "core/levels.hpp"
#include "ocisac/cleaning/judge_cleaning.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

constexpr double kAgreement = 0.995;    // of a colour's tone with that of its group: 6 degrees of phase
constexpr double kStill = 0.8;          // correlation of the lights of two frames
constexpr std::size_t kMostMoved = 32;  // part of the rows that a picture moves by in a frame

// Gives the colours tones of their own where they differ from those of their groups.
void fit_tones(std::span<const BandedPicture> colours, ColourLights& found) {
  for (std::size_t colour = 0; colour < colours.size(); ++colour) {
    const ToneLight group = *found.of(colour).tone;
    ModelledLight own = light_of(refined_tone_light(ColumnBundles(colours[colour]), group.light, group));
    if (correlation(own.light, group.light) > kAgreement) continue;
    found.of_colour[colour] = found.lights.size();
    found.lights.push_back(std::move(own));
  }
}

// Chips that move with the picture do so, too; a tone would at any phase.
bool stand_still(const Values& before, const Values& now, RowModel model) {
  if (model == RowModel::tone) return correlation(before, now) > kStill;
  const std::size_t rows = now.size(), most = rows / kMostMoved;
  const auto likeness = [&](std::size_t first, std::size_t second) {
    return correlation(std::span(before).subspan(first, rows - most), std::span(now).subspan(second, rows - most));
  };
  for (std::size_t move = 0; move <= most; ++move)
    if (std::max(likeness(move, 0), likeness(0, move)) > kStill) return true;
  return false;
}

// False where row time or frame time is not known.
bool takes_whole_cycles(double frequency, const Camera& camera) {
  const double cycles = frequency / camera.row_time * camera.frame_time.value_or(kNaN);
  return std::abs(std::remainder(cycles, 1.0)) < kNextToNone;
}

}  // namespace

std::string objection_to_lines(std::span<const Values> frames, RowModel model, double frequency, const Camera& camera) {
  if (model != RowModel::tone && model != RowModel::chips) return {};
  if (model == RowModel::tone && takes_whole_cycles(frequency, camera)) return {};
  for (std::size_t k = 1; k < frames.size(); ++k)  // a slow advance of a tone adds up
    if (!stand_still(frames[model == RowModel::tone ? 0 : k - 1], frames[k], model)) return {};
  return frames.size() < 2 ? ""
                           : std::string(model == RowModel::tone ? "a tone that stands" : "chips that stand") +
                                 " still: lines of the picture";
}

std::string_view name_of(RowModel model) {
  switch (model) {
    case RowModel::automatic: return "auto";
    case RowModel::tone: return "tone";
    case RowModel::chips: return "chips";
    case RowModel::slow: return "slow";
    case RowModel::given: return "given";
    case RowModel::rows: break;
  }
  return "rows";
}

ModelledLight light_of(ToneLight tone) {
  Values rows = tone.light;
  const double full = *std::max_element(rows.begin(), rows.end()), frequency = tone.frequency;
  return {std::move(rows), full, RowModel::tone, frequency, std::move(tone)};
}

ModelledLight find_row_light(const ColumnBundles& picture, RowModel model) {
  RowLight rows = picture.free();
  const auto tone = [&](std::optional<double> enough) { return find_tone_light(picture, rows, enough); };
  const bool is_automatic = model == RowModel::automatic;
  if (is_automatic || model == RowModel::tone)
    if (auto found = tone(is_automatic ? std::optional(kNearlyAll) : std::nullopt)) return light_of(*std::move(found));
  if (is_automatic || model == RowModel::chips)
    if (auto found = find_chip_light(picture, rows, !is_automatic); found)
      if (!is_automatic || picture.gain(found->light) >= kMinGain) return *std::move(found);
  if (is_automatic)
    if (auto found = tone(kMostly)) return light_of(*std::move(found));
  const double full = quantile(rows.light, kBrightRows);
  return {.light = std::move(rows.light), .full = full, .tone = {}};
}

ColourLights find_colour_lights(std::span<const BandedPicture> colours, RowModel model) {
  require(!colours.empty(), "colours", 0, "at least one");
  ColourLights found{{}, std::vector<std::size_t>(colours.size())};
  for (const std::vector<std::size_t>& alike : alike_colours(colours)) {
    std::size_t light = 0;
    if (found.lights.empty() || found.lights.front().model != RowModel::rows) {
      ModelledLight own = find_row_light(sum_of(colours, alike), model);
      const ModelledLight& main = found.lights.empty() ? own : found.lights.front();
      const double away = std::abs(own.frequency - main.frequency) * static_cast<double>(main.light.size());
      if (found.lights.empty() || (own.model == main.model && away < kMostly)) {
        light = found.lights.size();
        found.lights.push_back(std::move(own));
      }
    }
    for (const std::size_t colour : alike) found.of_colour[colour] = light;
  }
  if (found.lights.front().tone && colours.size() > 1) fit_tones(colours, found);
  return found;
}

}  // namespace ocisac
