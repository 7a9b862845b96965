#include <limits>

#include "bindings.hpp"
#include "ocisac/cleaning/chip_light.hpp"
#include "ocisac/cleaning/colour_shares.hpp"
#include "ocisac/cleaning/column_bundles.hpp"
#include "ocisac/cleaning/judge_cleaning.hpp"
#include "ocisac/cleaning/light_share.hpp"
#include "ocisac/cleaning/picture_motion.hpp"
#include "ocisac/cleaning/restore_picture.hpp"
#include "ocisac/cleaning/row_misfit.hpp"
#include "ocisac/cleaning/row_model.hpp"
#include "ocisac/cleaning/slow_light.hpp"
#include "ocisac/cleaning/tone_light.hpp"

namespace ocisac::bindings {

namespace {

BandedPicture picture_of(const Doubles& light, const Doubles& variance) {
  require(light.ndim() == 3, "picture", light.ndim(), "3 dimensions (frames, rows, columns)");
  const auto length = [&](py::ssize_t axis) { return static_cast<std::size_t>(light.shape(axis)); };
  return {span_of(light), span_of(variance), length(0), length(1), length(2)};
}

py::array_t<double> run_light_share(const Doubles& light, const Doubles& variance, const Doubles& row_light,
                                    bool smooth) {
  const BandedPicture picture = picture_of(light, variance);
  const auto share = unlocked([&] { return light_share(picture, span_of(row_light), smooth); });
  return array_of(share, {light.shape(1), light.shape(2)});
}

py::tuple run_refine_row_light(const Doubles& light, const Doubles& variance, const Doubles& share,
                               const Doubles& row_light, int steps, const std::optional<Doubles>& basis,
                               double deviation) {
  const BandedPicture picture = picture_of(light, variance);
  const RowLightPrior model{basis ? span_of(*basis) : std::span<const double>{}, deviation};
  const RowLight result =
      unlocked([&] { return refine_row_light(picture, span_of(share), span_of(row_light), steps, model); });
  return py::make_tuple(array_of(result.light, {light.shape(1)}), array_of(result.information, {light.shape(1)}));
}

double run_row_misfit(const Doubles& light, const Doubles& variance, const Doubles& row_light, const Doubles& share,
                      std::size_t lag) {
  const BandedPicture picture = picture_of(light, variance);
  return unlocked([&] { return row_misfit(picture, span_of(row_light), span_of(share), lag); });
}

CleaningVerdict run_judge_cleaning(const Doubles& light, const Doubles& variance, const Doubles& row_light,
                                   const Doubles& share, std::size_t block_rows, std::size_t block_columns,
                                   std::size_t max_columns) {
  const BandedPicture picture = picture_of(light, variance);
  return unlocked([&] {
    return judge_cleaning(picture, span_of(row_light), {span_of(share), block_rows, block_columns}, max_columns);
  });
}

void register_verdict(py::module_& module) {
  using py::arg;
  py::class_<CleaningVerdict>(module, "CleaningVerdict")
      .def_readwrite("light_left", &CleaningVerdict::light_left)
      .def_readwrite("texture_change", &CleaningVerdict::texture_change)
      .def_readwrite("gain", &CleaningVerdict::gain)
      .def_readwrite("worse", &CleaningVerdict::worse)
      .def_readwrite("level", &CleaningVerdict::level)
      .def_readwrite("slow_bands", &CleaningVerdict::slow_bands)
      .def_readwrite("energy", &CleaningVerdict::energy)
      .def_property_readonly("objection", &objection_to);
  module.def("row_misfit", &run_row_misfit, arg("light"), arg("variance"), arg("row_light"), arg("share"), arg("lag"));
  module.def("judge_cleaning", &run_judge_cleaning, arg("light"), arg("variance"), arg("row_light"), arg("share"),
             arg("block_rows"), arg("block_columns"), arg("max_columns"));
  module.def(
      "mean_verdict", [](const std::vector<CleaningVerdict>& verdicts) { return mean_verdict(verdicts); },
      arg("verdicts"));
}

// One frame, (rows, columns).
BandedPicture frame_of(const Doubles& light, const Doubles& variance) {
  require(light.ndim() == 2, "picture", light.ndim(), "2 dimensions (rows, columns)");
  return {span_of(light), span_of(variance), 1, static_cast<std::size_t>(light.shape(0)),
          static_cast<std::size_t>(light.shape(1))};
}

py::tuple tuple_of(const RowLight& rows) { return py::make_tuple(array_of(rows.light), array_of(rows.information)); }

// The colours of (..., colours), one after the other.
std::vector<double> planes_of(const Doubles& picture) {
  std::vector<double> planes;
  planes.reserve(static_cast<std::size_t>(picture.size()));
  const py::ssize_t colours = picture.shape(picture.ndim() - 1);
  for (py::ssize_t colour = 0; colour < colours; ++colour)
    for (py::ssize_t i = colour; i < picture.size(); i += colours) planes.push_back(picture.data()[i]);
  return planes;
}

// Calls use(colours) with the pictures of (rows, columns, colours).
template <class Use>
auto with_colours(const Doubles& light, const Doubles& variance, Use use) {
  require(light.ndim() == 3 && variance.ndim() == 3, "picture", light.ndim(), "3 dimensions (rows, columns, colours)");
  require(variance.size() == light.size(), "variance", variance.size(), "one value a pixel");
  const std::vector<double> of_light = planes_of(light), of_variance = planes_of(variance);
  const auto rows = static_cast<std::size_t>(light.shape(0)), columns = static_cast<std::size_t>(light.shape(1));
  std::vector<BandedPicture> colours;
  for (std::size_t first = 0; first < of_light.size(); first += rows * columns) {
    const auto plane = [&](const std::vector<double>& all) { return std::span(all).subspan(first, rows * columns); };
    colours.push_back({plane(of_light), plane(of_variance), 1, rows, columns});
  }
  return unlocked([&] { return use(std::span<const BandedPicture>(colours)); });
}

RowModel row_model(const std::string& name) {
  for (const RowModel model : {RowModel::automatic, RowModel::tone, RowModel::chips, RowModel::rows})
    if (name == name_of(model)) return model;
  refuse("model", name, "auto, tone, chips or rows");
}

py::tuple run_find_colour_lights(const Doubles& light, const Doubles& variance, const std::string& model) {
  const RowModel asked = row_model(model);
  ColourLights found = with_colours(light, variance, [&](auto colours) { return find_colour_lights(colours, asked); });
  return py::make_tuple(std::move(found.lights), found.of_colour);
}

std::vector<py::array_t<double>> run_colour_shares(const std::vector<Doubles>& light,
                                                   const std::vector<Doubles>& variance,
                                                   const std::vector<Doubles>& row_light) {
  require(variance.size() == light.size() && row_light.size() == light.size(), "variance, row_light", variance.size(),
          "one array a colour");
  std::vector<BandedColour> colours;
  for (std::size_t k = 0; k < light.size(); ++k)
    colours.push_back({picture_of(light[k], variance[k]), span_of(row_light[k])});
  const auto shares = unlocked([&] { return colour_shares(colours); });
  std::vector<py::array_t<double>> arrays;
  for (std::size_t k = 0; k < shares.size(); ++k)
    arrays.push_back(array_of(shares[k], {light[k].shape(1), light[k].shape(2)}));
  return arrays;
}

void register_columns(py::module_& module) {
  using py::arg;
  py::class_<ColumnBundles>(module, "ColumnBundles")
      .def(py::init([](const Doubles& light, const Doubles& variance, const std::optional<Doubles>& share) {
             return ColumnBundles(frame_of(light, variance), share ? span_of(*share) : std::span<const double>{});
           }),
           arg("light"), arg("variance"), arg("share") = py::none())
      .def("free", [](const ColumnBundles& picture) { return tuple_of(unlocked([&] { return picture.free(); })); });
  module.def(
      "alike_colours",
      [](const Doubles& light, const Doubles& variance) { return with_colours(light, variance, alike_colours); },
      arg("light"), arg("variance"));
  module.def("colour_shares", &run_colour_shares, arg("light"), arg("variance"), arg("row_light"));
  module.def(
      "fully_modulated_rows", [](const Doubles& rows) { return array_of(fully_modulated_rows(span_of(rows))); },
      arg("rows"));
}

void register_row_models(py::module_& module) {
  using py::arg;
  py::class_<ToneLight>(module, "ToneLight")
      .def(py::init([](const std::vector<double>& light, double frequency, std::size_t harmonics) {
             return ToneLight{light, frequency, harmonics};
           }),
           arg("light"), arg("frequency"), arg("harmonics"))
      .def_property_readonly("light", [](const ToneLight& tone) { return array_of(tone.light); })
      .def_readonly("frequency", &ToneLight::frequency)
      .def_readonly("harmonics", &ToneLight::harmonics);
  py::class_<ModelledLight>(module, "ModelledLight")
      .def_property_readonly("light", [](const ModelledLight& one) { return array_of(one.light); })
      .def_readonly("full", &ModelledLight::full)
      .def_property_readonly("model", [](const ModelledLight& one) { return std::string(name_of(one.model)); })
      .def_readonly("frequency", &ModelledLight::frequency)
      .def_readonly("tone", &ModelledLight::tone);
  module.def("find_colour_lights", &run_find_colour_lights, arg("light"), arg("variance"), arg("model"));
  module.def(
      "find_row_light",
      [](const ColumnBundles& picture, const std::string& model) {
        const RowModel asked = row_model(model);
        return unlocked([&] { return find_row_light(picture, asked); });
      },
      arg("picture"), arg("model"));
  module.def(
      "unexplained_by_chips",
      [](const std::vector<double>& rows, const std::vector<double>& information) {
        return unlocked([&] { return unexplained_by_chips({rows, information}); });
      },
      arg("rows"), arg("information"));
  module.def(
      "followed_tone_light",
      [](const ColumnBundles& picture, const ToneLight& tone) {
        return unlocked([&] { return followed_tone_light(picture, tone); });
      },
      arg("picture"), arg("tone"));
}

std::vector<SlowLight> run_find_slow_lights(const Doubles& light, const Doubles& variance, const Camera& camera,
                                            const std::vector<CommonCourse>& earlier,
                                            const std::optional<SlowTone>& near) {
  require(light.ndim() == 4, "light", light.ndim(), "4 dimensions (frames, rows, columns, colours)");
  require(variance.size() == light.size(), "variance", variance.size(), "one value a pixel");
  const auto rows = static_cast<std::size_t>(light.shape(1)), columns = static_cast<std::size_t>(light.shape(2));
  const auto colours = static_cast<std::size_t>(light.shape(3));
  const std::vector<double> of_light = planes_of(light), of_variance = planes_of(variance);
  std::vector<std::vector<BandedPicture>> frames(static_cast<std::size_t>(light.shape(0)));
  for (std::size_t frame = 0; frame < frames.size(); ++frame)
    for (std::size_t colour = 0; colour < colours; ++colour) {
      const std::size_t pixels = rows * columns, first = (colour * frames.size() + frame) * pixels;
      const auto plane = [&](const std::vector<double>& all) { return std::span(all).subspan(first, pixels); };
      frames[frame].push_back({plane(of_light), plane(of_variance), 1, rows, columns});
    }
  return unlocked([&] { return find_slow_lights(frames, camera, earlier, near); });
}

void register_slow_light(py::module_& module) {
  using py::arg;
  py::class_<CommonCourse>(module, "CommonCourse").def_property_readonly("modes", [](const CommonCourse& course) {
    return array_of(course.modes);
  });
  py::class_<SlowTone>(module, "SlowTone")
      .def_readonly("cycles", &SlowTone::cycles)
      .def(
          "light", [](const SlowTone& tone, std::size_t rows) { return array_of(tone.light(rows)); }, arg("rows"))
      .def("depth", &SlowTone::depth, arg("rows"));
  py::class_<SlowVerdict>(module, "SlowVerdict")
      .def_readonly("left", &SlowVerdict::left)
      .def_readonly("worse", &SlowVerdict::worse)
      .def_readonly("level", &SlowVerdict::level);
  py::class_<SlowLight>(module, "SlowLight")
      .def_readonly("tones", &SlowLight::tones)
      .def_readonly("course", &SlowLight::course)
      .def_readonly("amplitude", &SlowLight::amplitude)
      .def_readonly("verdict", &SlowLight::verdict)
      .def_readonly("objection", &SlowLight::objection);
  module.attr("MOST_SLOW_FRAMES") = most_slow_frames;
  module.def("mode_count", &mode_count, arg("rows"));
  module.def(
      "common_course",
      [](const Doubles& light, const Doubles& variance) { return common_course(frame_of(light, variance)); },
      arg("light"), arg("variance"));
  module.def("find_slow_lights", &run_find_slow_lights, arg("light"), arg("variance"), arg("camera"), arg("earlier"),
             arg("near"));
}

LogPicture log_picture_of(const Doubles& values, const char* name) {
  require(values.ndim() == 2, name, values.ndim(), "2 dimensions (rows, columns)");
  return {span_of(values), static_cast<std::size_t>(values.shape(0)), static_cast<std::size_t>(values.shape(1))};
}

py::tuple run_picture_motion(const Doubles& before, const Doubles& after) {
  const LogPicture one = log_picture_of(before, "before"), other = log_picture_of(after, "after");
  const PictureMotion motion = unlocked([&] { return picture_motion(one, other); });
  const std::vector<py::ssize_t> shape{after.shape(0), after.shape(1)};
  return py::make_tuple(array_of(motion.down, shape), array_of(motion.right, shape));
}

py::array_t<double> run_moved_picture(const Doubles& values, const Doubles& down, const Doubles& right) {
  const LogPicture picture = log_picture_of(values, "values");
  const auto vector_of = [](const Doubles& ways) { return std::vector(ways.data(), ways.data() + ways.size()); };
  const PictureMotion motion{vector_of(down), vector_of(right)};
  const auto moved = unlocked([&] { return moved_picture(picture.values, picture.columns, motion); });
  return array_of(moved, {values.shape(0), values.shape(1)});
}

py::tuple run_picture_change(const Doubles& before, const Doubles& after) {
  const LogPicture one = log_picture_of(before, "before"), other = log_picture_of(after, "after");
  const PictureChange change = unlocked([&] { return picture_change(one, other); });
  const std::vector<py::ssize_t> shape{after.shape(0), after.shape(1)};
  return py::make_tuple(array_of(change.motion.down, shape), array_of(change.motion.right, shape),
                        array_of(change.is_new, shape));
}

void register_motion(py::module_& module) {
  using py::arg;
  module.def("picture_motion", &run_picture_motion, arg("before"), arg("after"));
  module.def("moved_picture", &run_moved_picture, arg("values"), arg("down"), arg("right"));
  module.def("picture_change", &run_picture_change, arg("before"), arg("after"));
}

template <class Sample>
using Picture = py::array_t<Sample, py::array::c_style>;

template <class Sample>
std::size_t columns_of(const Picture<Sample>& stored) {
  require(stored.ndim() == 2, "stored", stored.ndim(), "2 dimensions (rows, columns)");
  return static_cast<std::size_t>(stored.shape(1));
}

template <class Sample>
py::tuple run_merge_columns(const Picture<Sample>& stored, std::size_t merged, const Doubles& light,
                            const Doubles& variance) {
  const std::size_t columns = columns_of(stored);
  const auto result = unlocked([&] {
    return merge_columns(span_of(stored), columns, merged, {span_of(light), span_of(variance)});
  });
  const std::vector<py::ssize_t> shape{stored.shape(0), -1};
  return py::make_tuple(array_of(result.light).reshape(shape), array_of(result.variance).reshape(shape));
}

template <class Sample>
py::tuple run_restore_picture(const Picture<Sample>& stored, const Doubles& share, std::size_t block_rows,
                              std::size_t block_columns, const Doubles& rows, double level, double max_gain,
                              const Doubles& light, const Doubles& variance, const Doubles& bounds) {
  const std::size_t columns = columns_of(stored);
  const auto result = unlocked([&] {
    return restore_picture(span_of(stored), columns, {span_of(share), block_rows, block_columns},
                           {span_of(rows), level, max_gain}, {span_of(light), span_of(variance)}, span_of(bounds));
  });
  const std::vector<py::ssize_t> shape{stored.shape(0), stored.shape(1)};
  return py::make_tuple(array_of(result.picture, shape), array_of(result.marks, shape), array_of(result.share, shape));
}

template <class Sample>
void register_stored(py::module_& module) {
  using py::arg;
  module.def("merge_columns", &run_merge_columns<Sample>, arg("stored").noconvert(), arg("merged"), arg("light"),
             arg("variance"));
  module.def("restore_picture", &run_restore_picture<Sample>, arg("stored").noconvert(), arg("share"),
             arg("block_rows"), arg("block_columns"), arg("rows"), arg("level"), arg("max_gain"), arg("light"),
             arg("variance"), arg("bounds"));
}

}  // namespace

void register_cleaning(py::module_& module) {
  using py::arg;
  module.def("light_share", &run_light_share, arg("light"), arg("variance"), arg("row_light"), arg("smooth") = true);
  module.def(
      "comparison_lag",
      [](const Doubles& row_light) {
        require(row_light.ndim() == 2, "row_light", row_light.ndim(), "2 dimensions (frames, rows)");
        return comparison_lag(span_of(row_light), static_cast<std::size_t>(row_light.shape(1)));
      },
      arg("row_light"));
  module.def("refine_row_light", &run_refine_row_light, arg("light"), arg("variance"), arg("share"), arg("row_light"),
             arg("steps"), arg("basis") = py::none(), arg("deviation") = std::numeric_limits<double>::infinity());
  register_verdict(module);
  register_motion(module);
  register_columns(module);
  register_row_models(module);
  register_slow_light(module);
  register_stored<std::uint8_t>(module);
  register_stored<std::uint16_t>(module);
}

}  // namespace ocisac::bindings
