"""Sensing of whole pictures: regions found and measured, contrast restored, the command ``ocisac sense``."""

import json
import math

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera, Flag
from ocisac_fast.core.arrays import in_stored_order
from ocisac_fast.sensing import KnownMotion

ROW_TIME, FRAME_TIME, EXPOSURE = 22.2e-6, 1 / 30, 300e-6
CAMERA = Camera(ROW_TIME, EXPOSURE, FRAME_TIME)
SPEED = 1.751


def texture(frames, rows, columns, frequency, *, per_row=0.0, per_column=0.2, exposure=EXPOSURE, mean=70.0):
    """A full-depth cosine of the motion-induced frequency given; per_row and per_column: its cycles at rest."""
    j, n, k = np.ogrid[:frames, :rows, :columns]
    turns = frequency * (n * ROW_TIME + j * FRAME_TIME - exposure / 2) - per_row * n - per_column * k
    return mean * (1 + np.sinc(frequency * exposure) * np.cos(2 * np.pi * turns))


def scene(frames=3, seed=1, lit=True):
    """Still clutter, two moving textures and a round light, in bytes."""
    random = np.random.default_rng(seed)
    view = np.zeros((frames, 720, 960))
    view += 40 + 10 * random.standard_normal((30, 40)).repeat(24, 0).repeat(24, 1)
    view[:, :, 100:420] = 10 + texture(frames, 720, 320, 200 * SPEED)
    view[:, 360:640, 760:900] = 10 + texture(frames, 280, 140, 400 * SPEED, mean=60)
    y, x = np.mgrid[:720, :960]
    disc = ((y - 330) / 170) ** 2 + ((x - 600) / 70) ** 2 < 1
    if lit:
        waves = ocisac.integrate_exposure(ocisac.Tone(1517.0, amplitude=200.0), CAMERA, 720, start=0.0, frames=frames)
        view += disc * waves[..., None]
    view += 2 * random.standard_normal(view.shape)
    return np.clip(np.rint(view), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def frames():
    return scene()


def test_contrast_at_the_row_rate_is_not_known() -> None:
    camera = ocisac.Camera(22.2e-6, exposure=200e-6, frame_time=1 / 30)
    light = 120 + 80 * np.sin(2 * np.pi * 1000 * 22.2e-6 * np.arange(240))[:, np.newaxis]
    frames = light + 2 * np.random.default_rng(0).standard_normal((3, 240, 24))
    assert ocisac.restore_contrast(frames, camera, 45045.045).flags & ocisac.Flag.UNRESOLVABLE


def test_finds_and_measures_lights_and_moving_textures(frames):
    found = ocisac.sense(frames, CAMERA, unlit=scene(seed=1, lit=False), motion=KnownMotion(pitch=1e-3))
    assert sorted(one.kind for one in found) == ["light", "moving", "moving"]
    light = next(one for one in found if one.kind == "light")
    wide, small = (one for one in sorted(found, key=lambda one: one.x) if one.kind == "moving")
    assert (wide.x, wide.y, wide.width, wide.height) == pytest.approx((100, 0, 320, 720), abs=2)
    assert (small.x, small.y, small.width, small.height) == pytest.approx((760, 360, 140, 280), abs=4)
    for one, fx in ((wide, 200), (small, 400)):
        assert one.motion_frequency == pytest.approx(fx * SPEED, abs=4 * one.motion_frequency_std)
        assert one.direction == 1
        assert not one.flags
    assert wide.speed == pytest.approx(SPEED, rel=1e-4)
    assert light.frequency == pytest.approx(1517, abs=4 * light.frequency_std)
    assert light.gain == pytest.approx(np.sinc(1517 * EXPOSURE), rel=0.02)  # of all pixels in the box around the disc
    assert light.background_given


def test_gain_of_a_found_texture_with_the_light_beside_it_told(frames):
    wide = max(ocisac.sense(frames, CAMERA), key=lambda one: one.width)
    cut = frames[:, wide.y : wide.y + wide.height, wide.x : wide.x + wide.width]
    found = ocisac.sense_region(cut, CAMERA, background=10.0)
    assert found.gain == pytest.approx(found.theory, abs=1e-3)


def test_the_background_is_measured_beside_lights():
    view = np.full((2, 720, 300), 30.0)
    waves = ocisac.integrate_exposure(ocisac.Tone(1517.0, amplitude=200.0), CAMERA, 720, start=0.0, frames=2)
    view[:, :, 120:180] += waves[..., None]
    view += np.random.default_rng(3).normal(0, 2, view.shape)
    stored = np.rint(view).astype(np.uint8)
    (alone,) = ocisac.sense(stored, CAMERA)
    (light,) = ocisac.sense(stored, CAMERA, beside=True)
    assert light.kind == "light"
    assert light.gain == pytest.approx(light.theory, abs=4 * light.gain_std)
    assert not alone.background_given
    assert alone.gain == pytest.approx(light.theory * 100 / 130, rel=0.02)
    (known,) = ocisac.sense(stored[:, :, 60:240], CAMERA, beside=True)
    assert known.x == pytest.approx(60, abs=2)


def test_motion_along_the_rows_in_a_picture():
    view = np.full((2, 720, 200), 60.0)
    view[:, :, 64:160] = texture(2, 720, 96, 230 * SPEED, per_row=0.023, per_column=0.0)
    view += np.random.default_rng(3).normal(0, 2, view.shape)
    (found,) = ocisac.sense(view, CAMERA, motion=KnownMotion(pitch=1e-4, spatial_frequency=230.0))
    assert found.kind == "moving"
    assert found.motion_frequency == pytest.approx(230 * SPEED, abs=4 * found.motion_frequency_std)
    assert found.direction == 1


@pytest.mark.parametrize("count", [1, 3])
def test_finds_nothing_where_nothing_moves(count):
    found = []
    for seed in range(3):
        random = np.random.default_rng(seed)
        clutter = 60 + 20 * random.standard_normal((18, 24)).repeat(40, 0).repeat(20, 1)
        view = clutter + 2 * random.standard_normal((count, 720, 480))
        found += ocisac.sense(view.clip(0, 255).astype(np.uint8), CAMERA)
    assert not found


def test_one_frame_finds_textures_and_says_that_they_may_be_still(frames):
    wide = max(ocisac.sense(frames[0], CAMERA), key=lambda one: one.width)
    assert wide.frequency == pytest.approx(200 * SPEED, abs=4 * wide.frequency_std)
    assert wide.flags & Flag.AMBIGUOUS_KIND


# Contrast


def noisy(cycles, rows=2000, noise=2.0, columns=40, seed=0, frequency=350.2):
    """A texture under an exposure of so many of its cycles, and the camera."""
    light = texture(1, rows, columns, frequency, exposure=cycles / frequency)[0]
    return light + np.random.default_rng(seed).normal(0, noise, light.shape), Camera(ROW_TIME, cycles / frequency)


@pytest.mark.parametrize("cycles", [0.2, 0.6, 0.8, 0.9, 1.3, 1.5, 2.4])
def test_restored_contrast_is_that_of_theory(cycles):
    columns, camera = noisy(cycles)
    found = ocisac.restore_contrast(columns, camera, 350.2)
    assert found.before == pytest.approx(abs(np.sinc(cycles)), abs=4 * found.before_std)
    assert found.after == pytest.approx(found.expected, abs=4 * found.after_std)
    null = min(abs(350.2 - m * 350.2 / cycles) for m in (1, 2, 3))
    if null * 2000 * ROW_TIME > 3 and abs(np.sinc(cycles)) > 0.1:  # cycles in the frame to the next null
        assert found.theory == 1
        assert found.after == pytest.approx(1, abs=0.02)


def test_the_boost_ends_the_restoration_before_the_null():
    columns, camera = noisy(0.97, rows=4000)
    small = ocisac.restore_contrast(columns, camera, 350.2, max_boost=5)
    assert small.theory == pytest.approx((5 * np.sinc(0.97)) ** 2)
    assert small.after == pytest.approx(small.expected, abs=4 * small.after_std)
    assert small.after < 0.2


def test_noise_ends_it():
    """The relative error is that of the blurred columns; where it reaches a third, nothing is told any more."""
    for cycles, noise, ended in ((0.9, 2.0, False), (0.9, 1500.0, True), (1.0, 2.0, True)):
        columns, camera = noisy(cycles, noise=noise)
        found = ocisac.restore_contrast(columns, camera, 350.2)
        assert bool(found.flags & Flag.WEAK) == ended
    quiet, loud = (ocisac.restore_contrast(*noisy(0.6, noise=noise), 350.2) for noise in (5.0, 50.0))
    assert loud.after_std / quiet.after_std == pytest.approx(10, rel=0.1)
    assert quiet.snr_after / loud.snr_after == pytest.approx(100, rel=0.2)
    assert quiet.snr_after < quiet.snr_before  # noise of all frequencies is boosted, the texture's little


@pytest.mark.parametrize("method", ["inverse", "wiener"])
@pytest.mark.parametrize("depth", [1.0, 0.5])
def test_restored_contrast_is_that_of_equalised_columns(method, depth):
    """The equaliser, and the contrast before and after it, the ends of two exposures left out."""
    columns, camera = noisy(0.6, rows=540, columns=5)
    found = ocisac.restore_contrast(columns, camera, 350.2, method=method, depth=depth)
    restored = ocisac.tones.equalize(columns, camera, method=method, max_boost=10.0)
    np.testing.assert_array_equal(found.columns, restored)
    ends = min(math.ceil(2 * camera.exposure / ROW_TIME), 540 // 4)
    before = ocisac.sense_region(columns, camera, 350.2, depth=depth)
    after = ocisac.sense_region(restored[ends:-ends], Camera(ROW_TIME, camera.exposure), 350.2, depth=depth)
    assert (found.before, found.before_std) == pytest.approx((before.gain, before.gain_std), rel=1e-6)
    assert found.after == pytest.approx(after.gain, rel=1e-6)
    relative = before.gain_std / before.gain * math.sqrt(540 / (540 - 2 * ends))
    assert found.after_std == pytest.approx(max(after.gain_std, after.gain * relative), rel=1e-6)
    assert found.before == pytest.approx(abs(np.sinc(0.6)) / depth, abs=4 * found.before_std)
    assert found.snr_before == pytest.approx(0.5 * (depth * before.gain) ** 2 * 70**2 / 2.0**2, rel=0.1)
    assert not found.flags
    if method == "inverse":
        assert found.theory == 1
        assert found.after == pytest.approx(1 / depth, abs=0.02 + 4 * found.after_std)
        h = np.sinc(np.linspace(0, 0.5, 1 << 16) * camera.exposure / ROW_TIME)
        loudness = 2.0 * math.sqrt(np.mean((h / np.maximum(h**2, 0.01)) ** 2))
        assert found.snr_after == pytest.approx(0.5 * (after.contrast * after.mean / loudness) ** 2, rel=0.1)


# Command


TIMES = ("--row-time", "22.2us", "--exposure", "300us", "--frame-rate", "30")


def test_command_tells_regions_in_stored_pixels(run, facts, frames, tmp_path):
    np.save(tmp_path / "scene.npy", frames.transpose(0, 2, 1)[:, ::-1])
    arguments = ("sense", tmp_path / "scene.npy", *TIMES, "--scan-axis", "x", "--pitch", "1mm")
    (found,) = facts(*arguments, "--plot", tmp_path / "scene.png")
    assert found["frames"] == 3
    wide = max(found["regions"], key=lambda one: one["height"])
    assert (wide["x"], wide["y"], wide["width"], wide["height"]) == pytest.approx((0, 540, 720, 320), abs=2)
    assert wide["kind"] == "moving"
    assert wide["speed_m_s"] == pytest.approx(SPEED, rel=1e-3)
    assert wide["direction"] == -1  # columns are mirrored
    assert wide["flags"] == []
    assert (tmp_path / "scene.png").read_bytes().startswith(b"\x89PNG")
    code, out, err = run(*arguments)
    assert (code, err) == (0, [])
    assert "1.751 m/s" in " ".join(out)
    assert "light" in " ".join(out)


@pytest.mark.parametrize("lit", [True, False])
def test_command_finds_the_axis_by_phases_that_advance_with_time(run, facts, tmp_path, lit):
    """Stripes that move across the rows look like lights along the other axis, without a light too."""
    view, found = scene(lit=lit), []
    for turned, axis in ((False, "y"), (True, "x")):
        np.save(tmp_path / "scene.npy", view.transpose(0, 2, 1) if turned else view)
        (told,) = facts("sense", tmp_path / "scene.npy", *TIMES)
        assert (told["scan_axis"], told["rows"], told["columns"]) == (axis, 720, 960)
        found.append([(one["kind"], one["frequency_hz"], one["gain"]) for one in told["regions"]])
        assert ("scan axis x" in " ".join(run("sense", tmp_path / "scene.npy", *TIMES)[1])) == turned
        region = ("--region", "0,120,720,200" if turned else "120,0,200,720")
        _, out, _ = run("sense", tmp_path / "scene.npy", *TIMES, *region, "--json")
        assert json.loads(*out)["scan_axis"] == axis
    assert [kind for kind, _, _ in found[0]] == [kind for kind, _, _ in found[1]]
    for upright, turned_one in zip(*found, strict=True):
        assert upright[1:] == pytest.approx(turned_one[1:], rel=1e-12)  # sums of rows and of columns round on their own
    assert len(found[0]) >= 2 + lit


def test_command_tells_a_stated_axis_against_the_phases(run, frames, tmp_path):
    np.save(tmp_path / "scene.npy", frames)
    code, out, err = run("sense", tmp_path / "scene.npy", *TIMES, "--scan-axis", "x", "--json")
    assert (code, json.loads(*out)["scan_axis"]) == (0, "x")
    assert err[-1].endswith("probably --scan-axis y")


def test_command_measures_one_region(run, frames, tmp_path):
    np.save(tmp_path / "scene.npy", frames)
    np.save(tmp_path / "dark.npy", np.full((1, 720, 960), 10, np.uint8))
    arguments = ("sense", tmp_path / "scene.npy", *TIMES, "--region", "120,0,200,720", "--json")
    _, out, _ = run(*arguments, "--unlit", tmp_path / "dark.npy", "--spatial-frequency", "200")
    (region,) = json.loads(*out)["regions"]
    assert region["gain"] == pytest.approx(region["theory"], abs=1e-3)
    assert region["speed_m_s"] == pytest.approx(SPEED, rel=1e-4)
    assert region["background_given"]
    _, told, _ = run(*arguments, "--background", "10", "--frequency", "350.2Hz", "--frames", "1", "--motion", "across")
    (region,) = json.loads(*told)["regions"]
    assert region["motion_frequency_std_hz"] == 0
    assert region["cycles_per_frame"] is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--speed", "1"), "--speed: needs --row-time"),
        (("--frame-rate", "30"), "--frame-rate: needs --row-time"),
        ((*TIMES[:4], "--frame-rate", "0"), "'--frame-rate': got 0 Hz, allowed: a finite number above 0"),
        ((*TIMES, "--frequency", "300"), "--frequency: needs --region"),
        ((*TIMES, "--background", "3"), "--background: needs --region"),
        ((*TIMES, "--region", "0,0,9,99", "--beside"), "--beside: not with --region"),
        ((*TIMES, "--pitch", "3kg"), "got '3kg', allowed: a number with or without unit, such as 0.3mm"),
        ((*TIMES, "--pitch", "0"), "pitch: got 0.0, allowed: a finite number above 0"),
        ((*TIMES, "--frames", "0"), "0 is not in the range"),
    ],
)
def test_command_refuses_in_one_line(run, tmp_path, options, message):
    np.save(tmp_path / "scene.npy", np.zeros((2, 100, 20), np.uint8))
    code, out, (line,) = run("sense", tmp_path / "scene.npy", *options)
    assert (code, out) == (2, [])
    assert message in line


@pytest.mark.parametrize(("axis", "option"), [("y", "--unlit"), ("-x", "--beside")])
def test_a_long_recording_gives_on_the_command_line_what_all_of_its_frames_give(axis, option, tmp_path, run):
    lit, dark = (in_stored_order(scene(10, seed=4, lit=lit), axis) for lit in (True, False))
    np.save(tmp_path / "lit.npy", lit)
    np.save(tmp_path / "dark.npy", dark)
    known = ["--beside"] if option == "--beside" else ["--unlit", str(tmp_path / "dark.npy")]
    given = [*TIMES, f"--scan-axis={axis}"]
    code, out, _ = run("sense", tmp_path / "lit.npy", "--frames", 10, "--json", *known, *given)
    assert code == 0
    told = json.loads(*out)["regions"]
    asked = {"beside": True} if option == "--beside" else {"unlit": dark}
    found = ocisac.sense(lit, Camera(ROW_TIME, EXPOSURE, FRAME_TIME, scan_axis=axis), **asked)
    assert [(one["x"], one["y"], one["width"], one["height"]) for one in told] == [one.region for one in found]
    for name in ("gain", "gain_std", "mean", "frequency_hz", "frequency_std_hz"):
        values = [getattr(one, name.removesuffix("_hz")) for one in found]
        shown = [math.nan if one[name] is None else one[name] for one in told]
        # Products of matrices round by their shape: with AVX-512 one standard error of a frequency differs by 2e-8.
        assert shown == pytest.approx(values, rel=1e-6 if "std" in name else 1e-9, nan_ok=True)
