#include "bindings.hpp"
#include "ocisac/cleaning/judge_cleaning.hpp"
#include "ocisac/cleaning/scene_light.hpp"
#include "ocisac/cleaning/stored_scene.hpp"
#include "ocisac/cleaning/stream_cleaner.hpp"

namespace ocisac::bindings {

namespace {

RowModel row_model(const std::string& name) {
  for (const RowModel model : {RowModel::automatic, RowModel::tone, RowModel::chips, RowModel::rows, RowModel::slow})
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
    for (std::size_t colour = 0; colour < frame.of_colour.size(); ++colour) lights.back().push_back(frame.of(colour));
  }
  return lights;
}

py::list shares_as_arrays(const SceneLight& light, const StoredScene& scene) {
  py::list result;
  for (const BlockShares& shares : light.shares) {
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

// Arrays (rows, columns) that are written to; shares that are wanted.
struct Written {
  py::array picture, marks;
  std::optional<py::array> share;
};

template <class Sample>
void restore_as(const StoredScene& scene, std::size_t frame, std::size_t colour, const BlockShares& shares,
                const Restoration& to, Written out) {
  RestoredPicture<Sample> result{mutable_view<Sample>(out.picture, "the type of the frames"),
                                 mutable_view<std::uint8_t>(out.marks, "uint8")};
  if (out.share) result.share = mutable_view<float>(*out.share, "float32");
  const auto fits = [&](const auto& view) {
    return view.frames == 1 && view.rows == scene.rows() && view.columns == scene.columns();
  };
  require(fits(result.picture) && fits(result.marks) && (!out.share || fits(result.share)), "out", result.picture.rows,
          "arrays of the shape of a frame");
  unlocked([&] { scene.restore<Sample>(frame, colour, shares, to, result); });
}

void run_restore(const HeldScene& held, std::size_t frame, std::size_t colour, const Doubles& share,
                 std::size_t block_rows, std::size_t block_columns, const Doubles& rows, double level, double max_gain,
                 const py::array& picture, const py::array& marks, const std::optional<py::array>& of_pixels) {
  const BlockShares shares{{share.data(), share.data() + share.size()}, block_rows, block_columns};
  const Restoration to{span_of(rows), level, max_gain};
  const bool is_bytes = held.arrays.front().dtype().equal(py::dtype::of<std::uint8_t>());
  const auto restore = is_bytes ? &restore_as<std::uint8_t> : &restore_as<std::uint16_t>;
  restore(held.scene, frame, colour, shares, to, {picture, marks, of_pixels});
}

py::tuple run_push(Shared<StreamCleaner>& cleaner, const std::vector<py::array>& colours, std::optional<double> time) {
  const std::vector<AnyFramesView> views = scene_views(colours);
  StreamCleaner::Frame frame = cleaner.call([&](StreamCleaner& one) { return one.push(views, time); });
  return tuple_of(colours, std::move(frame.stored), std::move(frame.light));
}

py::tuple run_again(Shared<StreamCleaner>& cleaner, const std::vector<py::array>& colours, std::size_t ago) {
  const std::vector<AnyFramesView> views = scene_views(colours);
  StreamCleaner::Frame frame = cleaner.call([&](const StreamCleaner& one) { return one.again(views, ago); });
  return tuple_of(colours, std::move(frame.stored), std::move(frame.light));
}

}  // namespace

void register_cleaning(py::module_& module) {
  using py::arg;
  py::class_<ModelledLight>(module, "ModelledLight")
      .def_property_readonly("light", [](const ModelledLight& one) { return array_of(one.light); })
      .def_readonly("full", &ModelledLight::full)
      .def_property_readonly("model", [](const ModelledLight& one) { return std::string(name_of(one.model)); })
      .def_readonly("frequency", &ModelledLight::frequency);
  py::class_<CleaningVerdict>(module, "CleaningVerdict")
      .def_readonly("light_left", &CleaningVerdict::light_left)
      .def_readonly("texture_change", &CleaningVerdict::texture_change)
      .def_readonly("slow_bands", &CleaningVerdict::slow_bands);
  py::class_<HeldScene>(module, "StoredScene")
      .def_property_readonly("toe", [](const HeldScene& held) { return held.scene.toe(); })
      .def_property_readonly("white", [](const HeldScene& held) { return held.scene.white(); })
      .def_property_readonly("by_table", [](const HeldScene& held) { return held.scene.by_table(); })
      .def("restore", &run_restore, arg("frame"), arg("colour"), arg("share"), arg("block_rows"), arg("block_columns"),
           arg("rows"), arg("level"), arg("max_gain"), arg("picture"), arg("marks"), arg("of_pixels"));
  py::class_<SceneLight>(module, "SceneLight")
      .def_property_readonly("lights", &lights_by_colour)
      .def_readonly("verdicts", &SceneLight::verdicts)
      .def_readonly("unchanged", &SceneLight::unchanged)
      .def("may_leave_slow", &SceneLight::may_leave_slow)
      .def("join", &SceneLight::join, arg("other"))
      .def("full_level", &SceneLight::full_level, arg("frame"), arg("colour"));
  module.def("find_scene_light", &run_find_scene_light, arg("colours"), arg("camera"), arg("model"), arg("noise"),
             arg("toe"), arg("given"), arg("full"));
  module.def(
      "objection_to_lines",
      [](const std::vector<std::vector<double>>& frames, const std::string& model, double frequency,
         const Camera& camera) { return objection_to_lines(frames, row_model(model), frequency, camera); },
      arg("frames"), arg("model"), arg("frequency"), arg("camera"));
  py::class_<Shared<StreamCleaner>>(module, "StreamCleaner")
      .def(py::init([](const Camera& camera, const std::string& model, std::optional<double> noise,
                       std::optional<double> toe) {
             return Shared<StreamCleaner>(StreamCleaner(camera, {row_model(model), noise, toe}));
           }),
           arg("camera"), arg("model"), arg("noise"), arg("toe"))
      .def("push", &run_push, arg("colours"), arg("time"))
      .def("again", &run_again, arg("colours"), arg("ago"))
      .def("forget", [](Shared<StreamCleaner>& cleaner) { cleaner.call([](StreamCleaner& one) { one.forget(); }); });
  module.def("lifted_light", py::vectorize(&lifted_light), arg("stored"), arg("toe"), arg("white"));
}

}  // namespace ocisac::bindings
