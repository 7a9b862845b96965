#include "bindings.hpp"
#include "ocisac/scene/render.hpp"

namespace ocisac::bindings {

namespace {

using Floats = py::array_t<float, py::array::c_style>;
using Indices = py::array_t<std::uint16_t, py::array::c_style>;
using Spans = py::array_t<std::uint32_t, py::array::c_style>;

// Constant data of a part for all frames; keeps the arrays alive that the ScenePart views.
struct HeldPart {
  std::size_t rows, columns;  // of the frame against which it was checked
  std::optional<Floats> gains;
  std::optional<Indices> phase;
  std::optional<Spans> spans;
  ScenePart part;
};

template <class Array>
void require_shape(const char* name, const Array& array, std::size_t rows, std::size_t columns) {
  require(array.ndim() == 2 && static_cast<std::size_t>(array.shape(0)) == rows &&
              static_cast<std::size_t>(array.shape(1)) == columns,
          name, array.ndim() == 2 ? array.shape(1) : array.ndim(), "an array of the shape that the part asks for");
}

HeldPart scene_part(std::size_t rows, std::size_t columns, std::size_t top, std::size_t left, std::size_t height,
                    std::size_t width, std::size_t phases, float gain, const std::optional<Floats>& gains,
                    const std::optional<Indices>& phase, const std::optional<Spans>& spans) {
  HeldPart held{rows, columns, gains, phase, spans, {}};
  ScenePart& part = held.part;
  part.region = {left, top, width, height};
  part.phases = phases, part.gain = gain;
  if (gains) {
    require_shape("gains", *gains, height, width);
    part.gains = gains->data();
  }
  if (phase) {
    require_shape("phase", *phase, height, width);
    part.phase = phase->data();
  }
  if (spans) {
    require_shape("spans", *spans, height, 2);
    part.spans = spans->data();
  }
  check(part, rows, columns);
  return held;
}

template <class T>
void render_as(const std::vector<ScenePart>& parts, const SceneBase& base, float white, int threads, py::array& out) {
  auto array = py::reinterpret_borrow<py::array_t<T>>(out);
  T* data = array.mutable_data();
  const auto frame =
      dense_view(data, 1, static_cast<std::size_t>(out.shape(0)), static_cast<std::size_t>(out.shape(1)));
  const py::gil_scoped_release released;
  render_parts<T>(parts, base, white, threads, frame);
}

std::vector<ScenePart> with_tables(const std::vector<const HeldPart*>& held, const std::vector<Floats>& tables,
                                   std::size_t rows, std::size_t columns) {
  require(tables.size() == held.size(), "tables", tables.size(), "one for each part");
  std::vector<ScenePart> parts;
  parts.reserve(held.size());
  for (std::size_t i = 0; i < held.size(); ++i) {
    parts.push_back(held[i]->part);
    require(held[i]->rows == rows && held[i]->columns == columns, "out", rows, "the frame that the parts are made for");
    require_shape("tables", tables[i], parts[i].region.height, parts[i].phases);
    parts[i].table = tables[i].data();
  }
  return parts;
}

void run_render(const std::vector<const HeldPart*>& held, const std::vector<Floats>& tables, float level,
                const std::optional<Floats>& image, float white, int threads, py::array out) {
  require(out.ndim() == 2 && (out.flags() & py::array::c_style), "out", out.ndim(), "a dense array (rows, columns)");
  require(threads >= 1, "threads", threads, "1 or more");
  const auto rows = static_cast<std::size_t>(out.shape(0));
  const auto columns = static_cast<std::size_t>(out.shape(1));
  if (image) require_shape("image", *image, rows, columns);
  const SceneBase base{level, image ? image->data() : nullptr};
  const std::vector<ScenePart> parts = with_tables(held, tables, rows, columns);
  if (out.dtype().is(py::dtype::of<std::uint8_t>())) return render_as<std::uint8_t>(parts, base, white, threads, out);
  if (out.dtype().is(py::dtype::of<std::uint16_t>())) return render_as<std::uint16_t>(parts, base, white, threads, out);
  if (out.dtype().is(py::dtype::of<float>())) return render_as<float>(parts, base, white, threads, out);
  refuse("out", std::string(py::str(out.dtype())), "uint8, uint16 or float32");
}

}  // namespace

void register_scene(py::module_& module) {
  using py::arg;
  py::class_<HeldPart>(module, "ScenePart")
      .def(py::init(&scene_part), py::kw_only(), arg("rows"), arg("columns"), arg("top"), arg("left"), arg("height"),
           arg("width"), arg("phases"), arg("gain"), arg("gains").noconvert(), arg("phase").noconvert(),
           arg("spans").noconvert());
  module.def("render_parts", &run_render, arg("parts"), arg("tables"), arg("level"), arg("image"), arg("white"),
             arg("threads"), arg("out"));
}

}  // namespace ocisac::bindings
