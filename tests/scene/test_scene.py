"""Scenes: geometry against OpenCV, frames against a waveform of its own for every pixel."""

import contextlib
import dataclasses
import math
import pathlib
import struct
import time
import zlib

import numpy as np
import pytest
from hypothesis import given, strategies as st

from ocisac_fast import Camera, Chips, Constant, Samples, SquareWave, Tone, TriangleWave
from ocisac_fast.reference import exact_scene, render_scene
from ocisac_fast.scene import (
    Ambient,
    Cosine,
    Disc,
    Grating,
    Mask,
    PathLoss,
    Picture,
    Pinhole,
    Plain,
    Pose,
    Rectangle,
    Ring,
    Scene,
    SceneFileError,
    Sensor,
    Source,
    Surface,
    load_scene,
    render,
    save_scene,
)

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "examples"
CAMERA = Camera(22.2e-6, 2404e-6, 1 / 30)
LENS = Pinhole(columns=24, rows=16, focal_length=4e-3, pixel_pitch=1e-4)
SENSOR = Sensor(200 / 2404e-6)


def scene_of(*objects, lens=LENS, camera=CAMERA, sensor=SENSOR, ambient=0.8):
    kinds = {"sources": Source, "surfaces": Surface, "masks": Mask}
    sorted_out = {name: [one for one in objects if isinstance(one, kind)] for name, kind in kinds.items()}
    return Scene(lens, camera, sensor, ambient=Ambient(ambient), **sorted_out)


vectors = st.tuples(*[st.floats(-0.5, 0.5)] * 3)
lenses = st.builds(
    Pinhole,
    columns=st.just(24),
    rows=st.just(16),
    focal_length=st.floats(1e-3, 1e-2),
    pixel_pitch=st.just(1e-4),
    principal_point=st.none() | st.tuples(st.floats(0, 24), st.floats(0, 16)),
    pose=st.builds(Pose, vectors, vectors),
)


@given(lens=lenses, depths=st.lists(st.floats(0.5, 10), min_size=1, max_size=5), side=st.floats(-2, 2))
def test_voxels_appear_where_opencv_projects_them(lens, depths, side):
    cv2 = pytest.importorskip("cv2")
    seen = np.array([[side, -side / 2, depth] for depth in depths])
    world = lens.pose.to_world(seen)
    turn = lens.pose.matrix.T
    shift = -turn @ np.array(lens.pose.position)
    x, y = lens.centre
    inner = np.array([[lens.focal_pixels, 0, x], [0, lens.focal_pixels, y], [0, 0, 1]])
    expected, _ = cv2.projectPoints(world, -np.array(lens.pose.rotation), shift, inner, None)
    np.testing.assert_allclose(lens.pixels_of(world), expected[:, 0], rtol=1e-9, atol=1e-9)
    rotation = cv2.Rodrigues(np.array(lens.pose.rotation))[0]
    np.testing.assert_allclose(lens.pose.matrix, rotation, atol=1e-12)


@given(lens=lenses, pixel=st.tuples(st.floats(0, 23), st.floats(0, 15)), distance=st.floats(0.1, 100))
def test_rays_are_the_inverse(lens, pixel, distance):
    voxel = np.array(lens.pose.position) + distance * lens.rays_of(pixel)
    np.testing.assert_allclose(lens.pixels_of(voxel), pixel, atol=1e-8)


def test_points_behind_the_camera_appear_nowhere():
    assert np.isnan(LENS.pixels_of([[0, 0, -1], [0.1, 0, 0]])).all()


def test_pixels_see_the_nearest_thing():
    scene = scene_of(
        Source(Disc(0.02), Pose((0, 0, 0.5)), Constant(1.0)),
        Surface(Rectangle(1, 1), Pose((0, 0, 1), (0, 0.3, 0))),
    )
    voxels = scene.voxels([[11.5, 7.5], [2, 7.5]])
    assert voxels.index.tolist() == [0, 1]
    np.testing.assert_allclose(voxels.points[0], [0, 0, 0.5], atol=1e-12)
    np.testing.assert_allclose(LENS.pixels_of(voxels.points), [[11.5, 7.5], [2, 7.5]], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(voxels.points, axis=1), voxels.distance)
    away = scene_of(Source(Disc(0.02), Pose((0, 0, 0.5)), Constant(1.0))).voxels([0, 0])
    assert away.index == -1
    assert np.isinf(away.distance)
    assert np.isnan(away.points).all()


def random_waveform(random, depth=0):
    """Light of any kind, at frequencies that the exposure keeps or wipes out."""
    frequency = 10 ** random.uniform(0.5, 5)
    phase = random.uniform(-4, 4)
    levels = random.uniform(0, 1, random.integers(1, 6))
    kind = random.integers(8 if depth == 0 else 4)
    if kind == 0:
        return Constant(random.uniform(0, 1))
    if kind == 1:
        return Tone(frequency, phase=phase, depth=random.uniform(0, 1))
    if kind == 2:
        return SquareWave(frequency, duty=random.uniform(0.1, 0.9), phase=phase)
    if kind == 3:
        return Chips(levels, min(frequency, 2e4), repeat=bool(random.integers(2)))
    if kind == 4:
        return Samples(levels, min(frequency, 2e4), repeat=bool(random.integers(2)))
    if kind == 5:
        return TriangleWave(frequency, phase=phase, depth=random.uniform(0, 1))
    first, second = random_waveform(random, 1), random_waveform(random, 1)
    return first * second if kind == 6 else 0.5 * first + 0.5 * second


def random_shape(random):
    a, b = random.uniform(0.1, 0.4, 2)
    return [Rectangle(a, b), Disc(a), Ring(a, b / 4 if b < 4 * a else a / 2)][random.integers(3)]


def random_pose(random):
    place = (*random.uniform(-0.1, 0.1, 2), random.uniform(0.3, 0.6))
    return Pose(place, (*random.uniform(-0.7, 0.7, 2), random.uniform(-3, 3)))


def random_pattern(random):
    low, high, duty = random.uniform(0, 1, 3)
    frequency, phase = random.uniform(5, 200), random.uniform(-4, 4)
    levels = random.uniform(0, 1, (random.integers(1, 3), random.integers(2, 6)))
    return [
        Plain(low),
        Cosine(frequency, low=low, high=high, phase=phase),
        Grating(frequency, duty=0.1 + 0.8 * duty, low=low, high=high, phase=phase),
        Picture(levels, *random.uniform(0.01, 0.2, 2)),
    ][random.integers(4)]


def random_loss(random):
    return (
        PathLoss(random.uniform(0, 2), reference=random.uniform(0.1, 1), attenuation=random.uniform(0, 1))
        if random.integers(2)
        else PathLoss()
    )


def random_scene(seed):
    """Any mixture of things, with one moving pattern on a ray at the most."""
    random = np.random.default_rng(seed)
    camera = Camera(10 ** random.uniform(-5.3, -4.3), 10 ** random.uniform(-5, -2), 1 / 30)
    masks_move = random.integers(2)

    def speed(moves):
        return float(random.choice([0, 1e-9, 1e-4, random.uniform(-5, 5), random.uniform(-5, 5)])) if moves else 0.0

    def patterned(moves):
        things = ("shape", random_shape), ("pose", random_pose), ("pattern", random_pattern)
        return {name: make(random) for name, make in things} | {"speed": speed(moves)}

    sources = [
        Source(
            random_shape(random),
            random_pose(random),
            random_waveform(random),
            intensity=random.uniform(0, 2),
            path_loss=random_loss(random),
            directivity=random.uniform(0, 3),
        )
        for _ in range(random.integers(1, 3))
    ]
    surfaces = [
        Surface(**patterned(not masks_move), path_loss=random_loss(random), lit_by_sources=bool(random.integers(2)))
        for _ in range(random.integers(1, 3))
    ]
    masks = [Mask(**patterned(masks_move and not index)) for index in range(random.integers(3))]
    lens = Pinhole(
        columns=14,
        rows=9,
        focal_length=random.uniform(1e-3, 4e-3),
        pixel_pitch=1e-4,
        principal_point=(random.uniform(0, 14), 4.3),
        pose=Pose(random.uniform(-0.05, 0.05, 3), random.uniform(-0.2, 0.2, 3)),
        velocity=random.uniform(-1, 1, 3) if random.integers(2) else (0, 0, 0),
    )
    ambient = Ambient(random.uniform(0, 1), waveform=random_waveform(random))
    return Scene(
        lens, camera, Sensor(200 / camera.exposure), sources=sources, surfaces=surfaces, masks=masks, ambient=ambient
    )


def check_bound(seed):
    scene = random_scene(seed)
    start, tolerance = (0.0, 1.23)[seed % 2], (0.01, 0.1, 0.5, 2.0, 10.0, 50.0)[seed % 6]
    plan = scene.plan(tolerance=tolerance, frames=2, start=start)
    expected = exact_scene(scene, 2, start)
    error = np.abs(np.stack(list(render(plan))) - expected).max()
    # the second frame of a moving camera is planned anew: to the tolerance
    bound = max(plan.bound, tolerance) if any(scene.lens.velocity) else plan.bound
    assert error <= bound * (1 + 1e-6) + 1e-12, f"seed {seed}\n{plan}"
    return plan, error, expected


@pytest.mark.parametrize("seed", range(40))
def test_error_stays_under_the_bound_of_the_plan(seed):
    plan, _, _ = check_bound(seed)
    assert plan.bound <= max(plan.tolerance, 0.05), str(plan)


@pytest.mark.nightly
def test_error_stays_under_the_bound_in_a_thousand_scenes():
    for seed in range(1000, 2000):
        check_bound(seed)


def small(scene, shrink):
    """The same view with fewer pixels, none of whose centres lies on the seams of the pattern."""
    lens = scene.lens
    few = {"columns": lens.columns // shrink, "rows": lens.rows // shrink, "pixel_pitch": lens.pixel_pitch * shrink}
    few["principal_point"] = (few["columns"] / 2 + 0.137, few["rows"] / 2 + 0.071)
    return dataclasses.replace(scene, lens=dataclasses.replace(lens, **few))


@pytest.mark.parametrize("name", ["testbed", "traffic_light", "taillights", "underwater"])
def test_examples_load_save_and_render(name, tmp_path):
    scene = small(load_scene(EXAMPLES / f"{name}.toml"), 12 if name == "underwater" else 24)
    save_scene(tmp_path / "again.toml", scene)
    again = load_scene(tmp_path / "again.toml")
    assert str(again) == str(scene)
    plan = scene.plan(tolerance=0.5, frames=2)
    first, second = render(plan, noise=True)
    assert first.shape == (scene.lens.rows, scene.lens.columns)
    assert first.dtype == np.uint8
    assert 100 < first.max() <= 255
    assert (first != second).any()
    np.testing.assert_array_equal(next(render(again.plan(tolerance=0.5, frames=2), frames=1, noise=True)), first)
    floats = dataclasses.replace(scene, sensor=Sensor(scene.sensor.gain), camera=linear(scene.camera))
    expected = exact_scene(floats)[0]
    assert np.abs(next(render(floats.plan(tolerance=0.5))) - expected).max() < 0.5


def linear(camera):
    return Camera(camera.row_time, camera.exposure, camera.frame_time)


TESTBED = (EXAMPLES / "testbed.toml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("row_time", "rowtime", 5, "camera.rowtime: unknown key, allowed: row_time"),
        ("speed", "sped", 34, "surfaces[0].sped: unknown key"),
        ("[ambient]", "[ambience]", 22, "ambience: unknown key, allowed: camera"),
        ("intensity = 0.7", "intensity = -1", 23, "ambient.intensity: got -1, allowed: a finite number, 0 or above"),
        ("diameter = 0.08", "diameter = 0", 26, "sources[0].shape.diameter: got 0, allowed"),
        ('kind = "grating"', 'kind = "stripe"', 33, "surfaces[0].pattern.kind: got 'stripe', allowed: plain"),
        ("frequency = 100.0", "high = 1.5, frequency = 9", 33, "surfaces[0].pattern.high: got 1.5, allowed"),
        ("frequency = 100.0", "low = 0", 33, "surfaces[0].pattern.frequency: missing"),
        ("[0.0, 0.0, 0.3]", "[0.0, 0.0, 0.0]", 27, "sources[0].position: got (0.0, 0.0, 0.0), allowed: before"),
        ("[0.0, 0.0, 0.3]", "[0.0, 0.0, -2]", 27, "sources[0].position: got (0.0, 0.0, -2.0), allowed: before"),
        ("[0.0, 0.0, 0.3]", "[0.0, 0.3]", 27, "sources[0].position: got [0.0, 0.3], allowed: 3 numbers"),
        ("exposure = 2404e-6", "exposure = 0", 6, "camera.exposure: got 0, allowed: above 0"),
        ("exposure = 2404e-6", "exposure = 'long'", 6, "camera.exposure: got 'long', allowed: a number"),
        ("bit_depth = 8", "bit_depth = 8.5", 17, "sensor.bit_depth: got 8.5, allowed: 1 to 16"),
    ],
)
def test_bad_files_are_refused_with_line_and_key(tmp_path, old, new, line, message):
    assert old in TESTBED
    (tmp_path / "bad.toml").write_text(TESTBED.replace(old, new, 1))
    with pytest.raises(SceneFileError) as caught:
        load_scene(tmp_path / "bad.toml")
    assert f"bad.toml:{line}: {message}" in str(caught.value)


PARTS = """
[[sources]]
shape = { kind = "disc", diameter = 0.1 }
position = [0.0, 0.0, 0.3]
[sources.waveform]
kind = "sum"
[[sources.waveform.parts]]
kind = "tone"
frequency = 100.0
[[sources.waveform.parts]]
kind = "tone"
frequency = BAD
"""


CHIPS = """
[[sources]]
shape = {{ kind = "disc", diameter = 0.1 }}
position = [0.0, 0.0, 0.3]
waveform = {{ kind = "chips", chip_rate = 2000.0, {} }}
"""


def refusal(tmp_path, text):
    """Message of `load_scene` for a scene with `text` instead of its sources and surfaces."""
    head = TESTBED[: TESTBED.index("[ambient]")]
    data = text if isinstance(text, bytes) else text.encode()
    (tmp_path / "bad.toml").write_bytes(head.encode() + data)
    with pytest.raises(SceneFileError) as caught:
        load_scene(tmp_path / "bad.toml")
    return str(caught.value), head.count("\n") + 1


def test_the_line_of_the_second_part_of_a_list_in_a_list(tmp_path):
    message, first = refusal(tmp_path, PARTS.replace("BAD", "-1"))
    assert f"bad.toml:{first + 11}: sources[0].waveform.parts[1].frequency: got -1" in message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CHIPS.format('levels = "01", repeat = "no"'), "waveform.repeat: got 'no', allowed: True or False"),
        (CHIPS.format("repeat = true"), "waveform.levels: missing"),
        (b"# \xff\n", "byte 0xff, allowed: UTF-8"),
        ("a = " + "[" * 5000 + "]" * 5000, "nested too deeply"),
        ("a = " + "{a = " * 5000 + "1" + "}" * 5000, "nested too deeply"),
        (".".join("a" * 100_000) + " = 1", "a key of more than 100 parts"),
        ("'='" + ".','" * 100_000 + " = 1", "a key of more than 100 parts"),
        ("x = [\n[" + " " * 100_000 + "\n1]]", "x: unknown key"),
        ("a = 1\nb = " + "1" * 100_000, "an integer of too many digits"),
    ],
    ids=["repeat", "levels", "utf8", "lists", "tables", "dots", "quoted", "blanks", "digits"],
)
def test_files_that_are_no_scene_are_refused_in_time(tmp_path, text, message):
    began = time.perf_counter()
    assert message in refusal(tmp_path, text)[0]
    assert time.perf_counter() - began < 5


def test_dots_in_numbers_strings_and_comments_are_no_keys(tmp_path):
    text = TESTBED + "# " + "." * 500 + "\n"
    text = text.replace("[0.0, 0.0, 0.3]", "[0.0, 0.0, 0.3] # " + "x." * 300)
    (tmp_path / "good.toml").write_text(text)
    assert str(load_scene(tmp_path / "good.toml")) == str(load_scene(EXAMPLES / "testbed.toml"))


SURFACE = """
[[surfaces]]
shape = {{ kind = "rectangle", width = 0.2, height = 0.1 }}
position = [0.0, 0.0, 0.3]
pattern = {{ kind = "picture", width = 0.2, height = 0.1, file = "{}" }}
"""


def test_pictures_of_a_scene_are_those_of_its_folder(tmp_path):
    image = pytest.importorskip("PIL.Image")
    folder = tmp_path / "scene"
    (folder / "below").mkdir(parents=True)
    levels = np.arange(8, dtype=np.uint8).reshape(2, 4) * 30
    for path in (folder / "below" / "in.png", tmp_path / "out.png"):
        image.fromarray(levels).save(path)
    (folder / "link.png").symlink_to(tmp_path / "out.png")
    (folder / "script.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\nshowpage\n")
    absurd = bytearray((tmp_path / "out.png").read_bytes())
    absurd[16:24] = struct.pack(">II", 50_000, 50_000)
    absurd[29:33] = struct.pack(">I", zlib.crc32(bytes(absurd[12:29])))
    (folder / "absurd.png").write_bytes(absurd)
    head = TESTBED[: TESTBED.index("[ambient]")]
    scene = folder / "scene.toml"

    def load(name, **options):
        scene.write_text(head + SURFACE.format(name))
        return load_scene(scene, **options).surfaces[0].pattern.levels

    np.testing.assert_array_equal(load("below/in.png"), levels / 255)
    for outside in ("../out.png", str(tmp_path / "out.png"), "link.png"):
        with pytest.raises(SceneFileError, match=r"file: got .*, allowed: a picture in the scene's folder"):
            load(outside)
        np.testing.assert_array_equal(load(outside, any_folder=True), levels / 255)
    for bad, message in [("script.png", "not a picture"), ("absurd.png", "pixels"), ("none.png", "No such file")]:
        with pytest.raises(SceneFileError, match=message):
            load(bad)


def test_a_picture_of_the_size_of_its_plate_lies_on_it():
    levels = np.linspace(0.1, 0.9, 8).reshape(2, 4)
    plate = Surface(Rectangle(0.4, 0.2), Pose((0, 0, 0.5)), pattern=Picture(levels, 0.4, 0.2))
    lens = Pinhole(columns=4, rows=2, focal_length=5e-3, pixel_pitch=1e-3)
    scene = scene_of(plate, lens=lens, camera=Camera(1e-5, 1e-4), sensor=Sensor(1e4), ambient=1.0)
    for frame in (next(render(scene.plan(tolerance=1e-3))), exact_scene(scene)[0]):
        np.testing.assert_allclose(frame, levels, rtol=1e-3)


def test_files_that_are_not_toml_are_refused(tmp_path):
    (tmp_path / "bad.toml").write_text("[camera\n")
    with pytest.raises(SceneFileError, match="line 1"):
        load_scene(tmp_path / "bad.toml")


def test_two_moving_patterns_on_one_ray_are_refused():
    turning = Mask(Disc(1), Pose((0, 0, 0.4)), pattern=Grating(50), speed=1.0)
    with pytest.raises(ValueError, match="masks: got 2 moving patterns before or on surface 0, allowed: one"):
        scene_of(turning, Surface(Disc(1), Pose((0, 0, 1)), pattern=Cosine(50), speed=1.0)).plan()


WIDE = Pinhole(columns=160, rows=16, focal_length=4e-3, pixel_pitch=1e-5)
WALL = Pose((0, 0, 1.0))


def wall(pattern, speed=0.0):
    return Surface(Rectangle(1, 1), WALL, pattern=pattern, speed=speed)


def mask(pattern):
    return Mask(Rectangle(1, 1), Pose((0, 0, 0.5)), pattern=pattern, speed=3.5)


def lamp(waveform, diameter=0.05):
    return Source(Disc(diameter), WALL, waveform)


AVERAGED = "drops modulation that the exposure averages"


@pytest.mark.parametrize(
    ("objects", "tolerance", "words"),
    [
        ([lamp(SquareWave(500))], 0.5, "pixels): keeps one row integral;"),
        ([lamp(SquareWave(5e5))], 0.5, f"constant, {AVERAGED}"),
        ([lamp(Tone(500, amplitude=1e-3))], 0.5, f"constant, {AVERAGED}"),
        ([wall(Plain(0.5))], 0.5, "constant; error up to 0 DN"),
        ([wall(Grating(50), 10.0)], 5.0, "keeps a table of "),
        ([wall(Grating(50), 10.0)], 0.05, "keeps every pixel's integral"),
        ([wall(Grating(50), 1e4)], 0.5, "drops texture"),
        ([wall(Cosine(50), 10.0)], 0.5, "keeps three row integrals"),
        ([wall(Cosine(50), 1e-3)], 0.5, "constant, drops motion too slow"),
        ([mask(Grating(100)), lamp(SquareWave(500), 1)], 10.0, "keeps a table of"),
        ([mask(Cosine(100)), lamp(Chips("0110", 900))], 0.5, "keeps three row integrals"),
        ([mask(Grating(100)), lamp(Tone(3e5))], 5.0, AVERAGED),
    ],
)
def test_plans_say_what_they_keep_and_hold_their_bound(objects, tolerance, words):
    scene = scene_of(*objects, lens=WIDE)
    plan = scene.plan(tolerance=tolerance)
    assert words in str(plan)
    assert plan.bound <= tolerance
    assert np.abs(next(render(plan)) - exact_scene(scene)[0]).max() <= plan.bound + 1e-9


def noisy_scene(**sensor):
    grey = Surface(Rectangle(9, 9), Pose((0, 0, 1)), pattern=Plain(0.5))
    lens = Pinhole(columns=200, rows=150, focal_length=4e-3, pixel_pitch=1e-4)
    return scene_of(grey, lens=lens, sensor=Sensor(200 / 2404e-6, full_well=10000.0, **sensor), ambient=1.0)


def test_noise_is_that_of_the_sensor_and_comes_from_the_seed():
    scene = noisy_scene(read_noise=20.0, shot_noise=True)
    plan = scene.plan(frames=2)
    first, second = render(plan, noise=True, seed=3)
    again, other = next(render(plan, noise=True, seed=3)), next(render(plan, noise=True, seed=4))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    assert (first != second).any()
    level, per_electron = 100.0, 255 / 10000.0
    spread = math.hypot(math.sqrt(level / per_electron), 20.0) * per_electron
    assert abs(first.mean() - level) < 5 * spread / math.sqrt(first.size)
    assert abs(first.std() / spread - 1) < 5 / math.sqrt(2 * first.size)
    clean = next(render(plan))
    np.testing.assert_allclose(clean, level, rtol=1e-6)
    assert scene.plan(tolerance=0.5, unit="noise").tolerance == pytest.approx(10 * per_electron)


@pytest.mark.parametrize(("curve", "stored"), [("gamma", (100 / 255) ** (1 / 2.2)), ("srgb", 0.6607)])
def test_tone_curve_bit_depth_and_saturation(curve, stored):
    camera = dataclasses.replace(CAMERA, tone_curve=curve)
    scene = dataclasses.replace(noisy_scene(bit_depth=8), camera=camera)
    assert set(next(render(scene.plan())).ravel().tolist()) == {round(255 * stored)}
    bright = dataclasses.replace(scene, ambient=Ambient(9.0))
    assert set(next(render(bright.plan())).ravel().tolist()) == {255}
    deep = dataclasses.replace(noisy_scene(bit_depth=12), camera=CAMERA)
    frame = next(render(deep.plan()))
    assert frame.dtype == np.uint16
    assert set(frame.ravel().tolist()) == {100}


@pytest.mark.parametrize("seed", range(3, 7))
def test_brute_force_comes_to_the_exact_integrals(seed):
    scene = dataclasses.replace(random_scene(seed), camera=Camera(2e-5, 3e-4, 1 / 30))
    exact, rough, fine = exact_scene(scene), render_scene(scene, subexposures=16), render_scene(scene, subexposures=512)
    assert np.abs(fine - exact).max() <= 0.02 * exact.max() + 1e-12
    assert np.abs(fine - exact).sum() <= np.abs(rough - exact).sum() + 1e-12


@given(data=st.data())
def test_damaged_scenes_are_read_or_refused(tmp_path_factory, data):
    text = (data.draw(st.sampled_from(sorted(EXAMPLES.glob("*.toml"))))).read_bytes()
    for _ in range(data.draw(st.integers(1, 6))):
        first = data.draw(st.integers(0, len(text)))
        last = data.draw(st.integers(first, min(first + 40, len(text))))
        new = data.draw(
            st.sampled_from([b"", b"[", b"[[", b"nan", b"-1", b"1e400", b'"', b"\xff", b"{}", text[first:last] * 2])
        )
        text = text[:first] + new + text[last:]
    path = tmp_path_factory.getbasetemp() / "damaged.toml"
    path.write_bytes(text)
    began = time.process_time()
    with contextlib.suppress(ValueError, OSError):
        load_scene(path)
    assert time.process_time() - began < 2
