// The light of the rows of a banded picture by the model that explains it: a tone, chips, or arbitrary rows.
#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/cleaning/column_bundles.hpp"

namespace ocisac {

// automatic: a tone that explains 90 % of the swing that rows have in common, else chips that explain 92 %, else a tone
// that explains 50 %, else arbitrary rows.
// slow: tones slower than kSlowestRows alone. given: by the caller; it is not searched.
enum class RowModel { automatic, tone, chips, rows, slow, given };

std::string_view name_of(RowModel model);

struct ToneLight {
  std::vector<double> light;  // of each row: mean 1, the darkest one 0
  double frequency = 0;       // cycles per row
  std::size_t harmonics = 1;
  double second = 0;  // cycles per row of the sine of a second lamp; 0: none
};

struct ModelledLight {
  std::vector<double> light;  // of each row, mean 1
  double full = 1;            // of a fully lit row
  RowModel model = RowModel::rows;
  double frequency =
      std::numeric_limits<double>::quiet_NaN();  // of the tone, or the chip rate, cycles or chips per row
  std::optional<ToneLight> tone;
};

// Mean, harmonics and slow terms are fitted to the rows at the frequency found in them; none if they do not explain
// `enough` of the rows' swing (no bound where it is empty). Periodic texture contributes to the rows too. It has few
// edges, so the tone is then fitted to the picture itself. Harmonics, or the sine of a second lamp, are added where the
// rows are much more probable with them.
// rows: (rows) estimated without a model (ColumnBundles::free), with their information.
std::optional<ToneLight> find_tone_light(const ColumnBundles& picture, const RowLight& rows,
                                         std::optional<double> enough);

// The tone fitted to the picture from `light`, of any phase; its frequencies, one Gauss–Newton step from those of
// `tone`.
ToneLight refined_tone_light(const ColumnBundles& picture, std::span<const double> light, ToneLight tone);

// Refines rows estimated without a model (ColumnBundles::free) with chips; none if chips do not explain 92 % of them,
// unless `always`. Rows drift, since the picture contributes to their slow changes: chips are detected without these,
// and their response is then fitted to the differences of neighbouring rows of the picture.
std::optional<ModelledLight> find_chip_light(const ColumnBundles& picture, const RowLight& rows, bool always);

// Share of the rows' swing, about the line through the tops of bright runs, that chips of one response leave
// unexplained; 1 without chips. Chips are additive in linear light only: a wrong tone curve increases it.
double unexplained_by_chips(const RowLight& rows);

ModelledLight find_row_light(const ColumnBundles& picture, RowModel model);

// Why the light of the rows of successive frames is none: chips of a light differ from frame to frame by more than a
// picture moves, and the phase of a tone advances, unless a frame takes a whole number of its cycles. Empty else.
// `frequency`: of the tone, cycles per row.
std::string objection_to_lines(std::span<const std::vector<double>> frames, RowModel model, double frequency,
                               const Camera& camera);

// The light of the rows under a tone.
ModelledLight light_of(ToneLight tone);

// Lights of the colours of a picture; colours of one light have the same index.
struct ColourLights {
  std::vector<ModelledLight> lights;
  std::vector<std::size_t> of_colour;

  [[nodiscard]] const ModelledLight& of(std::size_t colour) const { return lights[of_colour[colour]]; }
};

// The light of discharge lamps and of phosphors changes colour over a cycle. Colours of similar course are added. Other
// groups have tone or chips of their own if their frequency is that of the strongest group, else its light. Tones are
// then fitted to every colour.
ColourLights find_colour_lights(std::span<const BandedPicture> colours, RowModel model);

}  // namespace ocisac
