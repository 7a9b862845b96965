#include "ocisac/cleaning/row_model.hpp"

#include <algorithm>
#include <cmath>

#include "cleaning/chip_light.hpp"
#include "cleaning/merged_blocks.hpp"
#include "cleaning/quantile.hpp"
#include "core/statistics.hpp"
#include "ocisac/cleaning/judge_cleaning.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

constexpr double surely_tone = 0.9;     // of the rows' swing, where chips are not tried
constexpr double enough_of_tone = 0.5;  // the same where they are
constexpr double agreement = 0.995;     // of a colour's tone with that of its group: 6 degrees of phase
constexpr double same_cycles = 0.5;     // max. difference of the cycles in a frame of two colours of one light
constexpr double bright = 0.95;         // quantile: a fully lit row

ModelledLight light_of(Values rows, RowModel model, double frequency) {
  const double full = quantile(rows, bright);
  return {std::move(rows), full, model, frequency, {}};
}

ColumnBundles sum_of(std::span<const BandedPicture> colours, std::span<const std::size_t> some) {
  std::vector<BandedPicture> pictures;
  for (const std::size_t k : some) pictures.push_back(colours[k]);
  return ColumnBundles(sum_of(pictures).picture());
}

// Colours of similar course: their sum, and the index of their light.
struct Group {
  ColumnBundles picture;
  std::size_t light;
};

// Mean frequency of the groups' lights, weighted by the energies of their swings.
double mean_frequency(std::span<const Group> groups, std::span<const ModelledLight> lights) {
  double sum = 0, weights = 0;
  for (const Group& group : groups) {
    const double depth = group.picture.depth(lights[group.light].light);
    sum += depth * depth * lights[group.light].frequency;
    weights += depth * depth;
  }
  return weights > 0 ? sum / weights : lights.front().frequency;
}

// Gives the colours tones of their own at one frequency where they differ from those of their groups.
void fit_tones(std::span<const BandedPicture> colours, double frequency, ColourLights& found) {
  for (std::size_t colour = 0; colour < colours.size(); ++colour) {
    const ModelledLight& group = found.lights[found.of_colour[colour]];
    ModelledLight own = light_of(tone_light_at(ColumnBundles(colours[colour]), *group.tone, frequency));
    if (correlation(own.light, group.light) > agreement) continue;
    found.of_colour[colour] = found.lights.size();
    found.lights.push_back(std::move(own));
  }
}

}  // namespace

double correlation(std::span<const double> a, std::span<const double> b) {
  const double mean_a = mean_of(a), mean_b = mean_of(b);
  double aa = 0, ab = 0, bb = 0;
  for (std::size_t n = 0; n < a.size(); ++n) {
    aa += (a[n] - mean_a) * (a[n] - mean_a);
    ab += (a[n] - mean_a) * (b[n] - mean_b);
    bb += (b[n] - mean_b) * (b[n] - mean_b);
  }
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

std::string_view name_of(RowModel model) {
  switch (model) {
    case RowModel::automatic: return "auto";
    case RowModel::tone: return "tone";
    case RowModel::chips: return "chips";
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
    if (auto found = tone(is_automatic ? std::optional(surely_tone) : std::nullopt)) return light_of(*std::move(found));
  if (is_automatic || model == RowModel::chips)
    if (auto found = find_chip_light(picture, rows, !is_automatic); found)
      if (!is_automatic || picture.gain(found->light) >= min_gain)
        return light_of(std::move(found->light), RowModel::chips, found->rate);
  if (is_automatic)
    if (auto found = tone(enough_of_tone)) return light_of(*std::move(found));
  return light_of(std::move(rows.light), RowModel::rows, std::numeric_limits<double>::quiet_NaN());
}

ColourLights find_colour_lights(std::span<const BandedPicture> colours, RowModel model) {
  require(!colours.empty(), "colours", 0, "at least one");
  ColourLights found{{}, std::vector<std::size_t>(colours.size())};
  std::vector<Group> groups;
  for (const std::vector<std::size_t>& alike : alike_colours(colours)) {
    Group group{sum_of(colours, alike), 0};
    if (groups.empty()) {
      found.lights.push_back(find_row_light(group.picture, model));
    } else if (found.lights.front().model != RowModel::rows) {
      ModelledLight own = find_row_light(group.picture, model);
      const ModelledLight& main = found.lights.front();
      const double away = std::abs(own.frequency - main.frequency) * static_cast<double>(main.light.size());
      if (own.model == main.model && away < same_cycles) {
        group.light = found.lights.size();
        found.lights.push_back(std::move(own));
      }
    }
    for (const std::size_t colour : alike) found.of_colour[colour] = group.light;
    groups.push_back(std::move(group));
  }
  if (found.lights.front().tone && colours.size() > 1) fit_tones(colours, mean_frequency(groups, found.lights), found);
  return found;
}

}  // namespace ocisac
