#include <limits>

#include "bindings.hpp"
#include "ocisac/cleaning/column_bundles.hpp"
#include "ocisac/cleaning/judge_cleaning.hpp"
#include "ocisac/cleaning/light_share.hpp"
#include "ocisac/cleaning/picture_motion.hpp"
#include "ocisac/cleaning/restore_picture.hpp"
#include "ocisac/cleaning/row_misfit.hpp"
#include "ocisac/cleaning/scene_light.hpp"
#include "ocisac/cleaning/slow_light.hpp"
#include "ocisac/cleaning/stored_scene.hpp"
#include "ocisac/cleaning/stream_cleaner.hpp"

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
      .def_property_readonly("objection", [](const CleaningVerdict& verdict) { return objection_to(verdict); });
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

// The colours of (..., colours), one after the other.
std::vector<double> planes_of(const Doubles& picture) {
  std::vector<double> planes;
  planes.reserve(static_cast<std::size_t>(picture.size()));
  const py::ssize_t colours = picture.shape(picture.ndim() - 1);
  for (py::ssize_t colour = 0; colour < colours; ++colour)
    for (py::ssize_t i = colour; i < picture.size(); i += colours) planes.push_back(picture.data()[i]);
  return planes;
}

RowModel row_model(const std::string& name) {
  for (const RowModel model : {RowModel::automatic, RowModel::tone, RowModel::chips, RowModel::rows})
    if (name == name_of(model)) return model;
  refuse("model", name, "auto, tone, chips or rows");
}

// The scene and the arrays that it views.
struct HeldScene {
  std::vector<py::array> arrays;
  StoredScene scene;
};

std::vector<AnyFramesView> scene_views(const std::vector<py::array>& colours) {
  for (const py::array& colour : colours)
    require(colour.ndim() == 3, "frames", colour.ndim(), "3 dimensions for each colour");
  return views_of(colours);
}

std::vector<std::vector<ModelledLight>> lights_by_colour(const SceneLight& light) {
  std::vector<std::vector<ModelledLight>> lights;
  for (const ColourLights& frame : light.lights) {
    lights.emplace_back();
    for (const std::size_t k : frame.of_colour) lights.back().push_back(frame.lights[k]);
  }
  return lights;
}

py::list shares_as_arrays(const SceneLight& light, const StoredScene& scene) {
  py::list result;
  for (const KeptShares& shares : light.shares) {
    const std::size_t down = (scene.rows() + shares.block_rows - 1) / shares.block_rows;
    const std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(down),
                                         static_cast<py::ssize_t>(shares.share.size() / down)};
    result.append(py::make_tuple(array_of(shares.share, shape), shares.block_rows, shares.block_columns));
  }
  return result;
}

py::tuple tuple_of(std::vector<py::array> arrays, StoredScene scene, SceneLight light) {
  py::list shares = shares_as_arrays(light, scene);
  return py::make_tuple(HeldScene{std::move(arrays), std::move(scene)}, std::move(light), std::move(shares));
}

// Rows of each frame, (frames × rows), and the light of a fully lit one.
std::vector<ColourLights> given_lights(const Doubles& rows, double full, std::size_t colours) {
  require(rows.ndim() == 2, "light", rows.ndim(), "2 dimensions (frames, rows)");
  std::vector<ColourLights> lights;
  for (py::ssize_t frame = 0; frame < rows.shape(0); ++frame) {
    ModelledLight given;
    given.light.assign(rows.data(frame, 0), rows.data(frame, 0) + rows.shape(1));
    given.full = full;
    given.model = RowModel::given;
    lights.push_back({{std::move(given)}, std::vector<std::size_t>(colours)});
  }
  return lights;
}

py::tuple run_find_scene_light(const std::vector<py::array>& colours, const Camera& camera, const std::string& model,
                               std::optional<double> noise, std::optional<double> toe,
                               const std::optional<Doubles>& given, double full) {
  const RowModel asked = row_model(model);
  const std::vector<AnyFramesView> views = scene_views(colours);
  std::vector<ColourLights> lights;
  if (given) lights = given_lights(*given, full, colours.size());
  std::optional<StoredScene> scene;
  SceneLight light = unlocked([&] {
    scene.emplace(views, camera.tone_curve, noise, toe.value_or(0));
    return find_scene_light(*scene, camera, asked, toe.has_value(), lights);
  });
  return tuple_of(colours, *std::move(scene), std::move(light));
}

template <class Sample>
py::tuple restored_as(const StoredScene& scene, std::size_t frame, std::size_t colour, const KeptShares& shares,
                      const Restoration& to) {
  const auto done = unlocked([&] { return scene.restored<Sample>(frame, colour, shares, to); });
  const std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(scene.rows()),
                                       static_cast<py::ssize_t>(scene.columns())};
  return py::make_tuple(array_of(done.picture, shape), array_of(done.marks, shape), array_of(done.share, shape));
}

py::tuple run_restored(const HeldScene& held, std::size_t frame, std::size_t colour, const Doubles& share,
                       std::size_t block_rows, std::size_t block_columns, const Doubles& rows, double level,
                       double max_gain) {
  const KeptShares shares{{share.data(), share.data() + share.size()}, block_rows, block_columns};
  const Restoration to{span_of(rows), level, max_gain};
  const bool is_bytes = held.arrays.front().dtype().equal(py::dtype::of<std::uint8_t>());
  return is_bytes ? restored_as<std::uint8_t>(held.scene, frame, colour, shares, to)
                  : restored_as<std::uint16_t>(held.scene, frame, colour, shares, to);
}

py::tuple run_push(Shared<StreamCleaner>& cleaner, const std::vector<py::array>& colours, std::optional<double> time) {
  const std::vector<AnyFramesView> views = scene_views(colours);
  StreamCleaner::Frame frame = cleaner.call([&](StreamCleaner& one) { return one.push(views, time); });
  return tuple_of(colours, std::move(frame.stored), std::move(frame.light));
}

void register_scene_light(py::module_& module) {
  using py::arg;
  py::class_<ModelledLight>(module, "ModelledLight")
      .def_property_readonly("light", [](const ModelledLight& one) { return array_of(one.light); })
      .def_readonly("full", &ModelledLight::full)
      .def_property_readonly("model", [](const ModelledLight& one) { return std::string(name_of(one.model)); })
      .def_readonly("frequency", &ModelledLight::frequency);
  py::class_<HeldScene>(module, "StoredScene")
      .def_property_readonly("toe", [](const HeldScene& held) { return held.scene.toe(); })
      .def_property_readonly("white", [](const HeldScene& held) { return held.scene.white(); })
      .def_property_readonly("by_table", [](const HeldScene& held) { return held.scene.by_table(); })
      .def("restored", &run_restored, arg("frame"), arg("colour"), arg("share"), arg("block_rows"),
           arg("block_columns"), arg("rows"), arg("level"), arg("max_gain"));
  py::class_<SceneLight>(module, "SceneLight")
      .def_property_readonly("lights", &lights_by_colour)
      .def_readonly("verdicts", &SceneLight::verdicts)
      .def_readonly("unchanged", &SceneLight::unchanged)
      .def("level", &SceneLight::level, arg("frame"), arg("colour"), arg("full"));
  module.def("find_scene_light", &run_find_scene_light, arg("colours"), arg("camera"), arg("model"), arg("noise"),
             arg("toe"), arg("given"), arg("full"));
  py::class_<Shared<StreamCleaner>>(module, "StreamCleaner")
      .def(py::init([](const Camera& camera, const std::string& model, std::optional<double> noise,
                       std::optional<double> toe) {
             return Shared<StreamCleaner>(StreamCleaner(camera, {row_model(model), noise, toe}));
           }),
           arg("camera"), arg("model"), arg("noise"), arg("toe"))
      .def("push", &run_push, arg("colours"), arg("time"))
      .def("forget", [](Shared<StreamCleaner>& cleaner) { cleaner.call([](StreamCleaner& one) { one.forget(); }); });
  module.def(
      "fully_modulated_rows", [](const Doubles& rows) { return array_of(fully_modulated_rows(span_of(rows))); },
      arg("rows"));
  module.def("lifted_light", py::vectorize(&lifted_light), arg("stored"), arg("toe"), arg("white"));
  module.def("slope_of_lifted", py::vectorize(&slope_of_lifted), arg("stored"), arg("toe"), arg("white"));
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
  const EarlierFrames before{earlier, earlier.empty() ? 0 : earlier.back().place + 1};
  return unlocked([&] { return find_slow_lights(frames, camera, before, near); });
}

void register_slow_light(py::module_& module) {
  using py::arg;
  py::class_<CommonCourse>(module, "CommonCourse")
      .def_property_readonly("modes", [](const CommonCourse& course) { return array_of(course.modes); })
      .def_property_readonly("variance", [](const CommonCourse& course) { return array_of(course.variance); });
  py::class_<SlowTone>(module, "SlowTone")
      .def_readonly("cycles", &SlowTone::cycles)
      .def(
          "light", [](const SlowTone& tone, std::size_t rows) { return array_of(tone.light(rows)); }, arg("rows"))
      .def("cycle", [](const SlowTone& tone) { return array_of(tone.cycle()); });
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
  register_scene_light(module);
  register_slow_light(module);
  register_stored<std::uint8_t>(module);
  register_stored<std::uint16_t>(module);
}

}  // namespace ocisac::bindings
