"""The command line: units, geometry, what each command prints, and how it refuses."""

import importlib
import io
import json
import math
import os
import pathlib
import re
import resource
import signal
import subprocess
import sys
import time

import numpy as np
import PIL.Image as image
import pytest
from hypothesis import given, strategies as st

from ocisac_fast.chips import DETECTORS
from ocisac_fast.cli.application import ocisac
from ocisac_fast.cli.output import emit_table, plain, quantity, with_spread
from ocisac_fast.cli.outputs import InputFile, OutputFile, OutputFolder
from ocisac_fast.cli.pictures import PictureOptions, open_pictures, select
from ocisac_fast.cli.units import Quantity
from ocisac_fast.core import Region
from ocisac_fast.files import read_frames, write_frames

TESTBED = ("--row-time", "22.2us", "--exposure", "622us")
DARK = ("--dark-level", "16")  # so that noise is not clipped at 0
SQUARE = ("--waveform", "square")


# Units


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("9.2us", "s", 9.2e-6),
        ("622us", "s", 622e-6),
        ("22.2 µs", "s", 22.2e-6),
        ("1/8000s", "s", 1 / 8000),
        ("1/8000", "s", 1 / 8000),
        ("3ms", "s", 3e-3),
        ("5e-6", "s", 5e-6),
        ("7ns", "s", 7e-9),
        ("2s", "s", 2.0),
        ("4.95kHz", "Hz", 4950.0),
        ("500Hz", "Hz", 500.0),
        ("500hz", "Hz", 500.0),
        (".5MHz", "Hz", 5e5),
        ("-3Hz", "Hz", -3.0),
        ("0.01", "Hz", 0.01),
    ],
)
def test_units_give_the_nearest_number(text, unit, value):
    parsed = Quantity.parse(text, unit)
    assert float(parsed) == value
    assert parsed.has_unit == text.lower().endswith(unit.lower())


@pytest.mark.parametrize("text", ["", "us", "9.2uss", "9.2 apples", "1,5us", "9.2Hz", "1/0s", "0x10", "9.2 u", "1//2"])
def test_what_is_no_time_is_refused(run, text):
    code, out, err = run("calibrate", "missing.png", "--frequency", "1kHz", "--row-time", text)
    assert (code, out) == (2, [])
    assert err == [
        f"ocisac: Invalid value for '--row-time': got {text!r}, allowed: a number with or without unit, such as 9.2us"
    ]


@given(st.floats(1e-9, 1e9), st.sampled_from(["s", "Hz"]))
def test_what_is_printed_can_be_read_back(value, unit):
    assert float(Quantity.parse(quantity(value, unit, 9), unit)) == pytest.approx(value, rel=1e-8)


def test_json_knows_no_nan_and_no_numpy():
    record = {"a": np.float32(0.5), "b": math.nan, "c": [np.inf, np.int64(3)], "d": np.arange(2), "e": np.bool_(True)}
    assert json.dumps(plain(record), allow_nan=False) == '{"a": 0.5, "b": null, "c": [null, 3], "d": [0, 1], "e": true}'


def test_names_that_differ_stay_different():
    from ocisac_fast.cli.output import _line

    names = [b"x\xff", b"x\\xff", b"x\\x5cxff", b"x\\\xff", b"x\\\\xff", b"x\\y"]
    texts = [plain(os.fsdecode(name)) for name in names]
    assert texts == [r"x\xff", r"x\x5cxff", r"x\x5cx5cxff", r"x\\xff", r"x\\x5cxff", r"x\y"][: len(texts)]
    assert [json.loads(_line({"file": os.fsdecode(name)}))["file"] for name in names] == texts
    assert len(set(texts)) == len(names)


def test_a_spread_is_in_the_unit_of_its_value_or_finer():
    assert with_spread(9.2090395e-6, 1.2e-10, "s") == "9.20904 µs ± 0.12 ns"
    assert with_spread(0.5, math.nan, "") == "0.5"


# Geometry


def options(**changed):
    unknown = dict.fromkeys(("row_time", "exposure", "region", "tone_curve", "dark_level", "white_level"))
    given = {"scan_axis": "y", "channel": "auto", "waveform": "tone", "duty": 0.5}
    return PictureOptions(**{**unknown, **given, **changed})


STORED = np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)


@pytest.mark.parametrize(
    ("changed", "want"),
    [
        ({}, STORED),
        ({"region": Region(2, 1, 4, 3)}, STORED[1:4, 2:6]),
        ({"region": Region(2, 1, 4, 3), "scan_axis": "-x"}, STORED[1:4, 2:6]),
        ({"channel": "b"}, STORED[..., 2]),
        ({"channel": 1}, STORED[..., 1]),
        ({"region": Region(0, 0, 8, 6)}, STORED),
    ],
)
def test_geometry_is_a_view_of_what_is_stored(changed, want):
    selected = select(STORED, options(**changed))
    assert np.array_equal(selected, want)
    assert np.shares_memory(selected, STORED)


@pytest.mark.parametrize(
    ("changed", "want"),
    [
        ({"scan_axis": "y"}, STORED),
        ({"scan_axis": "-y"}, STORED[::-1]),
        ({"scan_axis": "x"}, STORED.transpose(1, 0, 2)),
        ({"scan_axis": "-x"}, STORED[:, ::-1].transpose(1, 0, 2)),
        ({"region": Region(2, 1, 4, 3), "scan_axis": "-x"}, STORED[1:4, 5:1:-1].transpose(1, 0, 2)),
    ],
)
def test_row_batches_are_in_time_order_and_frames_as_stored(tmp_path, changed, want):
    np.save(tmp_path / "two.npy", np.stack([STORED, STORED]))
    with open_pictures(str(tmp_path / "two.npy"), options(**changed)) as pictures:
        assert pictures.camera.row_time is None
        assert pictures.camera.scan_axis == changed["scan_axis"]
        assert np.array_equal(next(pictures.row_batches()), [want, want])
    with open_pictures(str(tmp_path / "two.npy"), options(**changed)) as pictures:
        assert np.array_equal(next(pictures.batches())[1], select(STORED, options(**changed)))


def test_luma_is_the_weighted_sum():
    assert select(STORED, options(channel="y")) == pytest.approx(STORED @ np.array([0.299, 0.587, 0.114]))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"region": Region(1, 0, 8, 6)}, "--region: got 1,0,8,6, allowed: x,y,w,h inside the picture of 8 x 6 pixels"),
        ({"region": Region(0, 0, 8, 0)}, "--region: got 0,0,8,0"),
        ({"channel": 3}, "--channel: got 3, the picture has 3"),
    ],
)
def test_what_lies_outside_the_picture_is_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        select(STORED, options(**changed))


def test_a_grey_picture_has_no_red():
    with pytest.raises(ValueError, match="--channel: got r, the picture is grey"):
        select(STORED[..., 0], options(channel="r"))


# Simulation


@pytest.mark.parametrize("waveform", ["square", "triangle"])
def test_a_simulation_is_the_light_of_the_rows(facts, tmp_path, waveform):
    from ocisac_fast import Camera, SquareWave, TriangleWave, integrate_exposure

    path = tmp_path / "rows.npy"
    light = ("--waveform", waveform, "--frequency", "500Hz", "--duty", ".3", "--phase", "1")
    (printed,) = facts("simulate", *light, *TESTBED, "--rows", 300, "--columns", 4, "--bit-depth", "float", "-o", path)
    shape = {"frames": 1, "rows": 300, "columns": 4, "dtype": "float32"}
    assert printed == {"file": str(path), **shape, "row_time_s": 22.2e-6, "exposure_s": 622e-6}
    wave = SquareWave(500, duty=0.3, phase=1) if waveform == "square" else TriangleWave(500, phase=1)
    want = 200 * integrate_exposure(wave, Camera(22.2e-6, 622e-6), 300)
    values = np.load(path)
    assert values.shape == (300, 4)
    assert np.allclose(values, want[:, np.newaxis], atol=1e-4)


def test_what_goes_wrong_outside_a_laboratory_is_simulated(facts, tmp_path):
    from ocisac_fast import Camera, Chips, Tone
    from ocisac_fast.scene.simulation import lamp_bar, simulate_frames, texture

    path = tmp_path / "lamp.mkv"
    light = ("--waveform", "chips", "--bits", "0110", "--chip-rate", "8kHz", "--rise", "0.5", "--fall", "0.3")
    size = ("--rows", 90, "--columns", 40, "--frames", 3, "--frame-rate", 25, "--bit-depth", "16", "--swing", 80)
    wrong = ("--lamp-width", 9, "--tilt", 3, "--texture", "0.2", "--hum", "0.5", "--mains", 60, "--jitter", "50us")
    facts("simulate", *light, *TESTBED, *DARK, *size, *wrong, "--noise", 5, "--seed", 7, "-o", path)
    want = simulate_frames(
        Chips("0110", 8e3, repeat=True, rise=0.5, fall=0.3),
        Camera(22.2e-6, 622e-6, frame_time=1 / 25),
        *(90, 40, 3),
        swing=80.0,
        dark_level=16.0,
        lamp=lamp_bar(90, 40, 9.0, tilt=math.radians(3)),
        reflectance=texture(90, 40, 0.2, seed=7),
        ambient=Tone(120.0, amplitude=0.5),
        jitter=50e-6,
        noise=5.0,
        dtype=np.uint16,
        seed=7,
    )
    recording = read_frames(path)
    np.testing.assert_array_equal(recording.frames, list(want))
    assert recording.frame_rate == pytest.approx(25)


def test_noise_that_is_clipped_is_told(run, tmp_path):
    code, out, err = run("simulate", "--frequency", "500", *TESTBED, "--noise", "2", "-o", tmp_path / "x.npy", "--json")
    assert (code, len(out), len(err)) == (0, 1, 1)
    assert err[0].startswith("ocisac: warning: noise of dark rows is clipped at 0, which biases gains")


LIGHT = ("--frequency", "5", *TESTBED)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--frequency", "500", "--row-time", "22.2us"), "Missing option '--exposure'."),
        (TESTBED, "--waveform tone: needs --frequency"),
        (("--waveform", "chips", "--bits", "01", *TESTBED), "--waveform chips: needs --chip-rate"),
        (("--waveform", "chips", "--bits", "012", "--chip-rate", "1kHz", *TESTBED), "levels: got '012'"),
        (("--frequency", "nan", *TESTBED), "Invalid value for '--frequency': got 'nan'"),
        (("--frequency", "-5", *TESTBED), "--frequency: got -5"),
        ((*LIGHT, "--tilt", "3"), "--tilt: needs --lamp-width"),
        ((*LIGHT, "--jitter", "-1us"), "--jitter: got -1e-06"),
        ((*LIGHT, "--rows", "0"), "--rows: got 0, allowed: 1 to 268435456"),
        ((*LIGHT, "--rows", "99999", "--columns", "99999"), "rows x columns: got 99999 x 99999"),
        ((*LIGHT, "--frame-rate", "0"), "Invalid value for '--frame-rate': got 0 Hz, allowed: a finite"),
        ((*LIGHT, "--bit-depth", "12"), "Invalid value for '--bit-depth'"),
    ],
)
def test_a_simulation_without_meaning_is_refused(run, tmp_path, arguments, message):
    code, out, err = run("simulate", *arguments, "-o", tmp_path / "x.png")
    assert (code, out, len(err)) == (2, [], 1)
    assert err[0].startswith(f"ocisac: {message}")
    assert os.listdir(tmp_path) == []


# Results of the commands


THEORY = abs(np.sinc(500 * 622e-6))


@pytest.mark.parametrize("name", ["s.png", "s.tif", "s.npy", "s.mp4"])
def test_gain_is_that_of_theory_from_every_kind_of_file(facts, square, name):
    (got,) = facts("gain", square(name), *TESTBED, *DARK, "--frequency", "500Hz", "--waveform", "square")
    assert got["gain"] == pytest.approx(THEORY, abs=5 * got["gain_std"] + 1e-4)
    assert got["theory"] == pytest.approx(THEORY, rel=1e-12)
    assert 0 < got["gain_std"] < 1e-3
    assert got["frequency_std_hz"] is None
    assert (got["rows"], got["columns"], got["frames"], got["flags"]) == (720, 64, 1, [])
    assert got["phase_rad"] == pytest.approx(1, abs=0.01)
    assert got["background_given"] is False
    assert isinstance(got["rows"], int)


def test_the_frequency_is_found_with_its_standard_error(facts, square):
    (got,) = facts("gain", square("s.png"), *TESTBED, *DARK, "--frequency", "auto", "--waveform", "square")
    assert got["frequency_hz"] == pytest.approx(500, abs=5 * got["frequency_std_hz"] + 0.02)
    assert 0 < got["frequency_std_hz"] < 1


def test_frames_of_a_video_are_pooled_by_their_precision(facts, square):
    path = square("s.mkv", "--frames", 5)
    (one,) = facts("gain", square("s.png"), *TESTBED, *DARK, "--frequency", "500", "--waveform", "square")
    (got,) = facts("gain", path, *TESTBED, *DARK, "--frequency", "500", "--waveform", "square")
    assert got["frames"] == 5
    assert got["gain_std"] == pytest.approx(one["gain_std"] / math.sqrt(5), rel=0.1)
    assert got["gain"] == pytest.approx(THEORY, abs=5 * got["gain_std"] + 1e-4)


def test_limited_range_luma_is_black_at_sixteen(facts, run, tmp_path):
    from ocisac_fast import Camera, Tone, integrate_exposure

    light = integrate_exposure(Tone(500.0), Camera(22.2e-6, 622e-6), 720)
    luma = np.rint(np.repeat(16 + 200 * light[:, np.newaxis], 16, axis=1)).astype(np.uint8)
    write_frames(tmp_path / "grey.png", luma)
    (wrong,) = facts("gain", tmp_path / "grey.png", *TESTBED, "--frequency", "500")
    (right,) = facts("gain", tmp_path / "grey.png", *TESTBED, "--frequency", "500", "--dark-level", "16")
    (same,) = facts("gain", tmp_path / "grey.png", *TESTBED, "--frequency", "500", "--background", "16")
    assert wrong["gain"] < 0.9 * THEORY
    assert right["gain"] == pytest.approx(THEORY, abs=1e-3)
    assert same["gain"] == pytest.approx(THEORY, abs=1e-3)
    assert same["background_given"] is True


def test_the_best_channel_is_taken_unless_one_is_named(facts, square, tmp_path):
    frame = read_frames(square("s.png")).frames[0]
    noise = np.random.default_rng(5).integers(90, 110, frame.shape, dtype=np.uint8)
    write_frames(tmp_path / "c.png", [np.stack([noise, frame, noise], axis=-1)])
    options = (*TESTBED, *DARK, "--frequency", "500", "--waveform", "square")
    assert facts("gain", tmp_path / "c.png", *options)[0]["colour"] == 1
    assert "weak" in facts("gain", tmp_path / "c.png", *options, "--channel", "r")[0]["flags"]


@pytest.mark.parametrize(("level", "frequency", "flag"), [(0, "500", "no_light"), (7, "auto", "no_tone")])
def test_what_cannot_be_answered_is_null_and_flagged(run, tmp_path, level, frequency, flag):
    write_frames(tmp_path / "even.png", np.full((100, 8), level, np.uint8))
    options = (*TESTBED, "--frequency", frequency, "--json", "--plot", tmp_path / "even.svg")
    code, out, err = run("gain", tmp_path / "even.png", *options)
    assert (code, err) == (3, ["ocisac: warning: no gain was measured"])
    got = json.loads(out[0])
    assert got["gain"] is None
    assert flag in got["flags"]
    assert (tmp_path / "even.svg").exists()


def test_a_region_without_a_tone_is_no_success(run, tmp_path):
    write_frames(tmp_path / "even.png", np.full((100, 8), 7, np.uint8))
    assert run("sense", tmp_path / "even.png", *TESTBED)[0] == 0  # nothing is there
    code, out, _ = run("sense", tmp_path / "even.png", *TESTBED, "--region", "0,0,8,90")
    assert code == 3
    assert "no_tone" in "".join(out)


def test_a_frequency_in_khz_is_no_success(run, square):
    code, _, err = run("gain", square("s.png"), *TESTBED, "--frequency", "0.5")
    assert code == 3
    assert err == [
        "ocisac: warning: no gain was measured: the rows show 0.00799 cycles of the tone: is the frequency in kHz?"
    ]


@pytest.mark.parametrize("background", ["0", "-1e300"])
def test_gains_of_nearly_nothing_do_not_warn_of_the_division(run, tmp_path, background):
    """Columns without any of the tone, and beside it light whose inverse variance is beyond all numbers."""
    rows = 100 + 50 * np.sin(2.1 * np.arange(300))[:, None] + np.random.default_rng(0).standard_normal((300, 20))
    np.save(tmp_path / "other.npy", rows.astype(np.uint8))
    tone = ("--row-time", "40us", "--frequency", "1kHz", f"--background={background}")
    code, out, err = run("gain", tmp_path / "other.npy", *tone, "--json")
    assert (code, json.loads(out[0])["gain"], err) == (0, pytest.approx(0.0, abs=1e-9), [])


@pytest.mark.parametrize("options", [(), TESTBED, TESTBED[2:]])
def test_calibrate_measures_the_row_time(facts, square, options):
    (got,) = facts("calibrate", square("s.png"), "--frequency", "500Hz", *options)
    assert got["row_time_s"] == pytest.approx(22.2e-6, abs=5 * got["row_time_std_s"] + 1e-9)
    assert 0 < got["row_time_std_s"] < 1e-7


@pytest.mark.parametrize(("method", "exposure"), [("exact", None), ("search", None), ("closed-form", 0.5 / 500)])
def test_exposure_gives_what_the_function_gives(facts, method, exposure):
    from ocisac_fast import best_exposure

    (got,) = facts("exposure", "--comm", "500Hz", "--sense", "0.35kHz", "--method", method)
    best = best_exposure(500.0, 350.0, method=method)
    assert (got["exposure_s"], got["objective"]) == (best.exposure, best.objective)
    assert exposure is None or got["exposure_s"] == pytest.approx(exposure)


def test_exposure_takes_weights_bounds_and_steps(facts):
    (got,) = facts("exposure", "--comm", "500", "--sense", "350", "--bounds", "0.2ms,0.6ms", "--step", "22.2us")
    assert got["exposure_s"] == pytest.approx(27 * 22.2e-6)
    (comm,) = facts("exposure", "--comm", "500", "--sense", "350", "--weights", "1,0")
    assert comm["exposure_s"] == pytest.approx(1e-3)


BITS = "0100111010110001111001011010001"


@pytest.fixture
def chips(facts, tmp_path):
    light = ("--waveform", "chips", "--bits", BITS, "--chip-rate", "8kHz", "--noise", "2", "--columns", 40)
    camera = ("--row-time", "22.2us", "--exposure", "60us", "--frame-rate", "60")
    facts("simulate", *light, *camera, *DARK, "--frames", 3, "-o", tmp_path / "chips.mkv")
    return tmp_path / "chips.mkv"


def test_receive_gives_an_object_a_frame(facts, chips):
    got = facts("receive", chips, "--row-time", "22.2us", "--exposure", "60us", "--line-code", "none")
    assert [(each["frame"], each["source"], each["rows"]) for each in got] == [(0, 0, 720), (1, 0, 720), (2, 0, 720)]
    for each in got:
        assert each["bits"] in BITS * 6
        assert len(each["bits"]) in (126, 127)
        assert each["chip_rate_hz"] == pytest.approx(8000, rel=1e-3)
        assert each["rows_per_chip"] == pytest.approx(1 / (8000 * 22.2e-6), rel=1e-3)
        assert each["snr_db"] > 20


def test_the_table_of_receive_shows_the_bits(run, facts, chips):
    options = (chips, "--row-time", "22.2us", "--exposure", "60us")
    code, out, err = run("receive", *options)
    assert (code, err) == (0, [])
    for each in facts("receive", *options):
        assert any(line.split()[:1] == [str(each["frame"])] and each["bits"] in line for line in out)


def test_receive_takes_several_files_and_a_known_rate(facts, chips):
    options = ("--row-time", "22.2us", "--exposure", "60us", "--chip-rate", "8kHz")
    got = facts("receive", chips, chips, *options)
    assert [each["file"] for each in got] == [str(chips)] * 6
    assert [each["frame"] for each in got] == [0, 1, 2] * 2
    assert got[0]["bits"] == got[3]["bits"]


def test_info_names_what_a_report_needs(facts):
    import ocisac_fast

    (got,) = facts("info")
    assert got["version"] == ocisac_fast.__version__
    assert got["libraries"]["numpy"] == np.__version__
    assert got["simd_target"] in got["simd_targets"]
    assert tuple(got["detectors"]) == DETECTORS
    assert all(got[name] for name in ("commit", "compiler", "opencv", "python", "system"))


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_plots_are_drawn_without_a_display(run, square, chips, tmp_path, suffix):
    commands = {
        "gain": ("gain", square("s.png"), *TESTBED, *DARK, "--frequency", "500", *SQUARE),
        "rows": ("gain", square("r.png"), "--frequency", "0.0111", *SQUARE),
        "receive": ("receive", chips, "--row-time", "22.2us", "--exposure", "60us"),
        "exposure": ("exposure", "--comm", "500", "--sense", "350"),
    }
    magic = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}[suffix]
    for name, command in commands.items():
        plot = tmp_path / f"{name}{suffix}"
        code, out, err = run(*command, "--plot", plot)
        assert (code, err) == (0, [])
        assert len(out) >= 2
        assert plot.read_bytes().startswith(magic)


def test_the_demo_decodes_its_recordings_in_time(facts, tmp_path):
    begin = time.perf_counter()
    (got,) = facts("demo", "--directory", tmp_path / "demo")
    assert time.perf_counter() - begin < 30  # 10 s on a quiet machine
    assert got["text"] == "OC-ISAC!"
    assert len(got["settings"]) == 24
    for setting in got["settings"]:
        assert setting["gain"] == pytest.approx(setting["theory"], abs=5 * setting["gain_std"])
    recordings = ["banded.png", "chips.png", "demo.png", "lamp.mkv", "testbed.mkv", "video.mkv"]
    assert sorted(os.listdir(tmp_path / "demo")) == recordings


def test_the_demo_keeps_what_is_not_its_own(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    os.mkdir("demo")
    mine = pathlib.Path("demo/video.mkv")
    mine.write_text("mine")
    assert run("demo") == (
        2, [], ["ocisac: demo/video.mkv: not of the demo, allowed: another --directory, or --force to replace it"]
    )  # fmt: skip
    assert mine.read_text() == "mine"
    os.mkdir("waiting")
    os.mkfifo("waiting/testbed.mkv")  # whose reader would be waited for
    assert run("demo", "--directory", "waiting")[0] == 2
    assert run("demo", "--force")[0] == 0
    before = {name: os.stat(f"demo/{name}").st_ino for name in os.listdir("demo")}
    assert (len(before), run("demo")[0]) == (6, 0)  # twice in a row
    assert {name: os.stat(f"demo/{name}").st_ino for name in os.listdir("demo")} == before


def test_the_demo_ends_with_commands_that_run(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = run("demo", "--directory", "demo\x1b]0;\a")
    assert (code, err) == (0, [])
    assert all(line.isprintable() for line in out)
    assert any(line.startswith("ocisac is ") for line in out)
    commands = [line.split()[1:] for line in out if line.startswith("  ocisac ")]
    assert len(commands) == 3
    monkeypatch.chdir(tmp_path / "demo\x1b]0;\a")
    for words in commands:
        code, out, err = run(*words)
        assert (code, err) == (0, [])
        assert len(out) >= 3


def test_tables_for_people_hold_the_same_numbers(run, square):
    code, out, err = run("gain", square("s.png"), *TESTBED, *DARK, "--frequency", "500", "--waveform", "square")
    assert (code, err) == (0, [])
    assert any(line.split()[:1] == ["frequency"] and "500 Hz" in line for line in out)
    assert any("theory" in line and f"{THEORY:.5f}" in line for line in out)


def test_names_are_of_any_case(run, square):
    names = ("--tone-curve", "srgb", "--channel", "auto")
    lower = ("gain", square("s.png"), *TESTBED, *DARK, "--frequency", "500", *names)
    upper = ("GAIN", *lower[1:-3], "SRGB", "--Channel", "AUTO", "--JSON")
    assert run(*upper) == run(*lower, "--json")


def test_files_are_replaced_only_when_asked(run, square, tmp_path):
    source, other = square("s.png"), tmp_path / "kept.png"
    other.write_bytes(b"mine")
    plot = ("gain", source, *TESTBED, *DARK, "--frequency", "500", "--plot", other)
    assert run(*plot) == (2, [], [f"ocisac: --plot: got {other}, which exists, allowed: a new file, or --force"])
    for command in (("clean", source, source, "--force"), ("gain", source, *plot[2:-1], source, "--force")):
        code, _, err = run(*command)
        assert code == 2
        assert err[0].endswith(f"got {source}, which is read, allowed: another file")
    assert other.read_bytes() == b"mine"
    assert run(*plot, "--force")[0] == 0
    assert other.read_bytes().startswith(b"\x89PNG")


OUTPUT_OF_INPUT = {
    "the sent bits": ("receive", "s.png", *TESTBED, "--sent", "b.csv", "--table", "b.csv"),
    "lights": ("locate", "b.csv", "s.png", "--focal", "100", "--centre", "1,1", "--table", "b.csv"),
    "lights that are seen": ("locate", "s.png", "b.csv", "--focal", "100", "--centre", "1,1", "--csv", "b.csv"),
    "recordings": ("batch", ".", "-o", "r", "--table", "b.csv", "gain", "--frequency", "500", *TESTBED),
    "a pattern": ("batch", "*.csv", "-o", "r", "--table", "b.csv", "gain", "--frequency", "500", *TESTBED),
    "a scene": ("simulate", "b.csv", "-o", "b.csv"),
    "a payload by a link": ("transmit", "b.csv", "-o", "link.csv"),
}


@pytest.fixture
def own_files(square, tmp_path, monkeypatch):
    """A picture s.png and a file b.csv in the working folder."""
    square("s.png")
    monkeypatch.chdir(tmp_path)
    pathlib.Path("b.csv").write_text("mine")


@pytest.mark.usefixtures("own_files")
@pytest.mark.parametrize("words", OUTPUT_OF_INPUT.values(), ids=OUTPUT_OF_INPUT)
def test_what_is_read_is_never_written(run, words):
    os.symlink("b.csv", "link.csv")
    words = (*words[:1], "--force", *words[1:])
    code, _, err = run(*words)
    assert code == 2
    assert err[-1].endswith(".csv, which is read, allowed: another file")
    assert pathlib.Path("b.csv").read_text() == "mine"


BY_MISSING_FOLDERS = {
    "clean": ("clean", "s.png", "none/../s.png", *TESTBED),
    "a link": ("clean", "s.png", "link.png", *TESTBED),
    "marks": ("clean", "s.png", "o.png", "--marks", "none/../s.png", *TESTBED),
    "plot": ("gain", "s.png", *TESTBED, "--frequency", "500", "--plot", "none/../s.png"),
    "a table of columns": ("gain", "s.png", *TESTBED, "--frequency", "500", "--per-column", "none/../b.csv"),
    "table": ("gain", "s.png", *TESTBED, "--frequency", "500", "--table", "none/../b.csv"),
    "transmit": ("transmit", "b.csv", "-o", "none/../b.csv"),
    "simulate": ("simulate", "--frequency", "500", *TESTBED, "-o", "none/../s.png"),
    "a file as folder": ("transmit", "b.csv", "-o", "b.csv/../b.csv"),
    "a new file as folder": ("transmit", "b.csv", "-o", "new.csv/"),
    "results": ("batch", "s.png", "--workers", "0", "-o", "none/../r", "gain", "--frequency", "500", *TESTBED),
    "recordings": ("batch", "none/../s.png", "--workers", "0", "-o", "r", "gain", "--frequency", "500", *TESTBED),
    "a file with a slash": ("batch", "s.png/", "--workers", "0", "-o", "r", "gain", "--frequency", "500", *TESTBED),
    "a summary": ("batch", "--summary", "none/../r"),
}


@pytest.mark.usefixtures("own_files")
@pytest.mark.parametrize("words", BY_MISSING_FOLDERS.values(), ids=BY_MISSING_FOLDERS)
def test_a_path_through_a_missing_folder_is_refused(run, words):
    """As by the system: without the text ``none/..`` it would be the name of a file that is read."""
    os.symlink("none/../s.png", "link.png")
    before = {name: pathlib.Path(name).read_bytes() for name in ("s.png", "b.csv")}
    code, out, err = run(words[0], "--force", *words[1:])
    assert (code, out, len(err)) == (2, [], 1)
    assert re.search("[Nn]o such (file or )?directory|Not a directory", err[0])
    assert before == {name: pathlib.Path(name).read_bytes() for name in before}
    assert sorted(os.listdir()) == ["b.csv", "link.png", "s.png"]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("transmit", "--text", "x", "-o", "o.txt"), ".: no such directory to write to"),
        (("transmit", "{}/none", "-o", "{}/o.txt", "--table", "t.csv"), "working folder: No such file or directory"),
        (("batch", "s.png", "-o", "{}/r", "gain", "--frequency", "5"), "working folder: No such file or directory"),
    ],
)
def test_a_working_folder_that_was_removed_is_named(run, tmp_path, monkeypatch, words, line):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert run(*(word.format(tmp_path) for word in words)) == (2, [], [f"ocisac: {line}"])


TWO_OUTPUTS = {
    "marks": ("clean", "s.png", "m.png", "--marks", "m.png", *TESTBED),
    "a table": ("transmit", "--text", "hello", "-o", "t.csv", "--table", "t.csv"),
    "a folder": ("batch", "s.png", "-o", "t.csv", "--table", "t.csv", "gain", "--frequency", "500", *TESTBED),
    "the folder of the demo": ("demo", "--directory", "t.csv", "--table", "t.csv"),
    "another spelling": ("transmit", "--text", "hello", "-o", "t.csv", "--table", "./t.csv"),
    "a link": ("gain", "s.png", *TESTBED, "--frequency", "500", "--plot", "link.svg", "--table", "t.csv", "--force"),
}


@pytest.mark.parametrize("words", TWO_OUTPUTS.values(), ids=TWO_OUTPUTS)
def test_two_outputs_are_two_files(run, square, tmp_path, monkeypatch, words):
    square("s.png")
    monkeypatch.chdir(tmp_path)
    os.symlink("t.csv", "link.svg")
    code, out, err = run(*words)
    assert (code, out) == (2, [])
    assert re.fullmatch(r"ocisac: --\w+: got \S+, which \S+ writes too, allowed: another file", err[-1])
    assert sorted(os.listdir()) == ["link.svg", "s.png"]


@pytest.mark.parametrize("still", [(), ("--still",)])
@pytest.mark.parametrize("marks", ["m.png", "m.xyz"])
def test_marks_that_no_file_holds_are_refused_before_the_work(run, tmp_path, monkeypatch, marks, still):
    monkeypatch.chdir(tmp_path)
    write_frames("a.mkv", np.full((3, 48, 8), 90, np.uint8))
    code, out, (line,) = run("clean", "a.mkv", "o.mkv", "--row-time", "20us", "--marks", marks, *still)
    assert (code, out, os.listdir()) == (2, [], ["a.mkv"])
    assert "--marks: got" in line or "m.xyz: suffix: got" in line


@pytest.mark.parametrize("line", [b"x\xff", b'{"light":1,"x":%s,"y":2}' % (b"9" * 400)])
def test_a_line_of_lights_that_cannot_be_read_is_named(run, tmp_path, line):
    (tmp_path / "lights").write_text('{"light":1,"x_m":1,"y_m":2,"z_m":3}\n')
    (tmp_path / "seen").write_bytes(line)
    code, _, err = run("locate", tmp_path / "lights", tmp_path / "seen", "--focal", "100", "--centre", "1,1")
    assert (code, len(err)) == (2, 1)
    assert err[0].startswith(f"ocisac: {tmp_path / 'seen'}: line 1: ")


def test_a_text_of_any_bytes_is_sent(run, tmp_path):
    (tmp_path / "text").write_bytes(b"\xff")
    assert run("transmit", "--text", os.fsdecode(b"\xff")) == run("transmit", tmp_path / "text")


def test_a_warning_that_is_an_error_is_one_line(program, square, tmp_path):
    square("s.png")
    words = ("gain", "s.png", *TESTBED, "--frequency", "500")
    done = program(*words, cwd=tmp_path, env={**os.environ, "PYTHONWARNINGS": "error"})
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)


@pytest.mark.parametrize("has_links", [True, False])
def test_a_file_that_appears_meanwhile_is_kept(run, tmp_path, monkeypatch, has_links):
    module = importlib.import_module("ocisac_fast.cli.simulate")
    simulated = module.simulate_frames

    def frames(*arguments, **options):
        (tmp_path / "o.mkv").write_text("my only copy")
        yield from simulated(*arguments, **options)

    def no_link(*_, **__):
        raise PermissionError

    monkeypatch.setattr(module, "simulate_frames", frames)
    if not has_links:
        monkeypatch.setattr(os, "link", no_link)
    words = ("simulate", "--frequency", "500", *TESTBED, "--rows", 32, "--columns", 32, "-o", tmp_path / "o.mkv")
    code, out, err = run(*words)
    assert (code, out) == (2, [])
    assert err[-1].endswith("o.mkv: appeared during this run, and is kept")
    assert (tmp_path / "o.mkv").read_text() == "my only copy"
    assert os.listdir(tmp_path) == ["o.mkv"]
    assert run(*words, "--force")[0] == 0
    assert (tmp_path / "o.mkv").stat().st_size > 500
    (tmp_path / "o.mkv").unlink()
    monkeypatch.setattr(module, "simulate_frames", simulated)
    assert run(*words)[0] == 0
    assert os.listdir(tmp_path) == ["o.mkv"]


def link_another_folder(folder):
    (folder / "l").unlink()
    (folder / "l").symlink_to("lb")


def link_a_file(folder):
    (folder / "d.mkv").unlink()
    (folder / "d.mkv").symlink_to("lb/o.mkv")


def put_a_file_for_a_pipe(folder):
    (folder / "p.mkv").unlink()
    (folder / "p.mkv").write_text("my only copy")


def rename_the_folder(folder):
    (folder / "lb" / "o.mkv").rename(folder / "m" / "o.mkv")
    (folder / "m").rename(folder / "lb" / "m")


# The output, what is changed while it is written, the file that is to stay, and where the output is then.
MOVES = {
    "link to a folder": ("l/o.mkv", link_another_folder, "lb/o.mkv", "la/o.mkv"),
    "link to a file": ("d.mkv", link_a_file, "lb/o.mkv", "none.mkv"),
    "pipe": ("p.mkv", put_a_file_for_a_pipe, "p.mkv", None),
    "folder": ("m/o.mkv", rename_the_folder, "lb/m/o.mkv", None),
    "folder, another name": ("m/x.mkv", rename_the_folder, "lb/m/o.mkv", "lb/m/x.mkv"),
}


@pytest.mark.parametrize("force", [(), ("--force",)])
@pytest.mark.parametrize("is_begun", [False, True])
@pytest.mark.parametrize(("output", "change", "kept", "written"), MOVES.values(), ids=MOVES)
def test_an_output_goes_where_its_name_led_at_the_start(
    run, tmp_path, monkeypatch, output, change, kept, written, is_begun, force
):
    """Whatever becomes of links, folders and pipes meanwhile, no other file is replaced."""
    for name in ("la", "lb", "m"):
        (tmp_path / name).mkdir()
    (tmp_path / "lb" / "o.mkv").write_text("my only copy")
    (tmp_path / "l").symlink_to("la")
    (tmp_path / "d.mkv").symlink_to("none.mkv")
    os.mkfifo(tmp_path / "p.mkv")
    module = importlib.import_module("ocisac_fast.cli.simulate")
    simulated = module.simulate_frames

    def frames(*arguments, **options):
        made = list(simulated(*arguments, **options))
        if not is_begun:
            change(tmp_path)
        return (change(tmp_path) or frame if is_begun else frame for frame in made)

    monkeypatch.setattr(module, "simulate_frames", frames)
    words = ("simulate", "--frequency", "500", *TESTBED, "--rows", 32, "--columns", 32, "-o", tmp_path / output, *force)
    code, out, err = run(*words)
    if written is None and (output == "p.mkv" or not force):
        assert (code, out, err[-1]) == (2, [], f"ocisac: {tmp_path / output}: appeared during this run, and is kept")
        assert (tmp_path / kept).read_text() == "my only copy"
    else:
        assert code == 0
        assert (tmp_path / (written or kept)).stat().st_size > 500
        assert written is None or (tmp_path / kept).read_text() == "my only copy"
    assert not list(tmp_path.rglob(".*"))


def test_a_picture_of_a_scene_is_not_replaced(run, tmp_path):
    (tmp_path / "sub").mkdir()
    write_frames(tmp_path / "sub" / "tex.png", [np.full((4, 4), 9, np.uint8)])
    before = (tmp_path / "sub" / "tex.png").read_bytes()
    scene = (pathlib.Path(__file__).parents[2] / "examples" / "testbed.toml").read_text()
    picture = 'pattern = { kind = "picture", width = 0.2, height = 0.1, file = "sub/tex.png" }'
    (tmp_path / "s.toml").write_text(re.sub("pattern = .*", picture, scene))
    os.mkfifo(tmp_path / "pipe")
    for name in ("s.toml", "pipe"):  # which can be read only once
        with subprocess.Popen(["cp", "s.toml", "pipe"], cwd=tmp_path) as writer:
            code, _, err = run("simulate", tmp_path / name, "-o", tmp_path / "sub" / "tex.png", "--force")
            assert (code, err[-1].partition(", ")[2]) == (2, "which is read, allowed: another file")
            if name == "s.toml":
                writer.kill()
        assert (tmp_path / "sub" / "tex.png").read_bytes() == before


@pytest.mark.parametrize("chain", ["zip://x.png::", "zip::", "tar://x.png::"])
def test_an_archive_that_is_a_device_is_refused(run, chain):
    """/dev/zero was read without an end."""
    code, _, err = run("gain", f"{chain}/dev/full", *TESTBED, "--frequency", "500")
    assert (code, err[-1].partition(", ")[2]) == (2, "allowed: an archive that is a file")


def test_an_archive_that_is_read_is_not_replaced(run, square, tmp_path):
    import shutil

    square("s.npy")
    shutil.make_archive(str(tmp_path / "a"), "zip", tmp_path, "s.npy")
    (tmp_path / "a.zip").rename(tmp_path / "a.csv")
    words = ("gain", f"zip://s.npy::{tmp_path / 'a.csv'}", *TESTBED, "--frequency", "500")
    assert run(*words)[0] == 0
    code, _, err = run(*words, "--table", tmp_path / "a.csv", "--force")
    assert (code, err[-1].partition(", ")[2]) == (2, "which is read, allowed: another file")


@pytest.mark.parametrize(
    "words", [("--per-column", "o.csv"), *(("--plot", f"o.{kind}") for kind in ("png", "svg", "pdf"))]
)
def test_a_disk_that_is_full_is_named_with_the_file(square, program, tmp_path, words):
    square("s.png")
    limited = {"cwd": tmp_path, "preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))}
    done = program("gain", "s.png", *TESTBED, "--frequency", "500", *words, **limited)
    assert (done.returncode, done.stderr.splitlines()[-1:]) == (2, [f"ocisac: {words[1]}: File too large"])


def test_a_picture_does_not_depend_on_the_working_folder(square, program, tmp_path):
    square("s.png")
    drawn = []
    for name in ("plain", "styled"):
        (tmp_path / name).mkdir()
        if name == "styled":
            (tmp_path / name / "matplotlibrc").write_text("text.usetex: True\npath.sketch: 9, 9, 9\nfont.size: 30\n")
        words = ("gain", "../s.png", *TESTBED, "--frequency", "500", "--plot", "o.png")
        assert program(*words, cwd=tmp_path / name).returncode == 0
        drawn.append((tmp_path / name / "o.png").read_bytes())
    assert drawn[0] == drawn[1]


ENDLESS = {
    "sent bits": ("receive", "s.png", *TESTBED, "--sent", "/dev/zero"),
    "a payload": ("transmit", "/dev/zero"),
    "a scene": ("simulate", "/dev/zero", "-o", "o.png"),
    "places of lights": ("locate", "/dev/zero", "s.png", "--focal", "100", "--centre", "1,1"),
    "a picture": ("detect", "large.png", *TESTBED),
    "a piped picture": ("detect", "pipe", *TESTBED),
}


@pytest.mark.parametrize("words", ENDLESS.values(), ids=ENDLESS)
def test_files_without_end_are_refused(run, square, tmp_path, monkeypatch, words):
    from ocisac_fast.files import pictures

    monkeypatch.setattr(pictures, "_MOST_BYTES", 64 << 20)
    square("s.png")
    monkeypatch.chdir(tmp_path)
    head = pathlib.Path("s.png").read_bytes()[:40]
    pathlib.Path("large.png").write_bytes(head)
    os.truncate("large.png", 3 << 30)  # sparse
    os.mkfifo("pipe")
    writer = subprocess.Popen(["sh", "-c", "cat s.png /dev/zero > pipe"], stderr=subprocess.DEVNULL)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    code, out, err = run(*words)
    writer.kill()
    writer.wait()
    assert (code, out) == (2, [])
    assert err[-1].endswith(": more than 64 MiB, allowed: at most these")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 400 << 10


def test_ctrl_c_while_modules_are_imported_is_no_traceback(run, monkeypatch):
    class Interrupted:
        def find_spec(self, name, *_):
            if name == "ocisac_fast.cli.application":
                raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "ocisac_fast.cli.application")
    monkeypatch.setattr(sys, "meta_path", [Interrupted(), *sys.meta_path])
    assert run("info") == (130, [], [])


def test_nothing_is_loaded_before_the_command_line_handles_signals():
    program = "import re, sys; from ocisac_fast.cli import main; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert {name for name in loaded if name.startswith("ocisac_fast")} == {"ocisac_fast", "ocisac_fast.cli"}


@pytest.mark.parametrize(("cause", "code"), [(None, 2), (KeyboardInterrupt(), 130)])
@pytest.mark.parametrize("module", ["matplotlib.style", "pyarrow", "av", "ocisac_fast.cli.gain"])
def test_a_library_that_cannot_be_loaded_is_one_line(module, cause, code, run, square, tmp_path, monkeypatch):
    """Memory was too little, or an interrupt came within a module in C++, which makes an ImportError of it."""

    class Failing:
        def find_spec(self, name, *_):
            if name == module:
                raise ImportError("failed to map segment") from cause

    path = square("s.npy")
    write_frames(tmp_path / "s.mkv", read_frames(path).frames)
    for name in [name for name in sys.modules if f"{name}.".startswith(f"{module}.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Failing(), *sys.meta_path])
    words = ("gain", tmp_path / ("s.mkv" if module == "av" else "s.npy"), *TESTBED, "--frequency", "500Hz")
    found, _, err = run(*words, "--plot", tmp_path / "a.png", "--table", tmp_path / "a.parquet")
    assert (found, len(err), "failed to map segment" in str(err)) == (code, code == 2, code == 2)


def test_standard_input_is_read_once(run, square, monkeypatch):
    data = square("s.npy").read_bytes()

    class Standard:
        buffer = io.BytesIO(data)

    monkeypatch.setattr(sys, "stdin", Standard())
    code, _, err = run("receive", "-", "-", *TESTBED)
    assert (code, err[-1]) == (3, "ocisac: standard input: was read before, allowed: once")


def test_every_path_of_a_command_is_declared():
    """Checks follow from the types of parameters, so each path has one that says whether it is read or written."""
    import click

    context = click.Context(ocisac)
    for name in ocisac.list_commands(context):
        for param in ocisac.get_command(context, name).params:
            if isinstance(param.type, click.Path):
                assert isinstance(param.type, (InputFile, OutputFile, OutputFolder))
            else:
                assert not {"file", "files", "source", "target", "recordings"} & {param.name}


def test_of_several_files_the_bad_ones_are_named(run, square, tmp_path):
    good, missing = square("s.png"), tmp_path / "missing.png"
    code, out, err = run("receive", missing, good, *TESTBED, "--json")
    assert code == 3
    assert {json.loads(line)["file"] for line in out} == {str(good)}
    assert err == [f"ocisac: {missing}: No such file or directory"]


# Refusals in general

GREY = ("gain", "grey.png", "--frequency", "0.1")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nonsense",), "command: got 'nonsense', allowed: "),
        (("recieve", "x.png"), "command: got 'recieve', allowed: receive"),
        ((*GREY[:-1], "500Hz", "--row-time", "22.2"), "Invalid value for '--row-time': got 22.2 s"),
        (("gain",), "Missing argument 'FILE'."),
        (("gain", "x.png"), "Missing option '--frequency'."),
        (("gain", "x.png", "--frequency", "5", "--nonsense"), "No such option"),
        (("gain", "missing.png", "--frequency", "5"), "missing.png: No such file or directory"),
        (("gain", ".", "--frequency", "5"), ".: Is a directory"),
        (("transmit", "/proc/self/mem"), "/proc/self/mem: "),
        (("gain", "empty.png", "--frequency", "5"), "empty.png: empty file"),
        (("gain", "/proc/self/maps", "--frequency", "5"), "/proc/self/maps: empty file"),
        (("gain", "/proc/self/maps", "--frequency", "5", "--raw", "9x9"), "/proc/self/maps: empty file"),
        (("gain", "text.png", "--frequency", "5"), "text.png: not a picture, a video or a .npy array"),
        (("gain", "half.png", "--frequency", "5"), "half.png: truncated"),
        ((*GREY[:-1], "500Hz"), "--frequency: Hz needs --row-time; without it"),
        ((*GREY, "--exposure", "1ms"), "--exposure: needs --row-time"),
        ((*GREY, "--region", "0,0,99,1"), "--region: got 0,0,99,1, allowed"),
        ((*GREY, "--region", "1,2,3"), "Invalid value for '--region': got '1,2,3'"),
        ((*GREY, "--channel", "g"), "--channel: got g, the picture is grey"),
        ((*GREY, "--channel", "u"), "Invalid value for '--channel': got 'u'"),
        ((*GREY, "--tone-curve", "log"), "Invalid value for '--tone-curve'"),
        ((*GREY, "--tone-curve", "gamma:-1"), "gamma: got -1"),
        ((*GREY, "--scan-axis", "z"), "Invalid value for '--scan-axis'"),
        ((*GREY, "--plot", "p.txt"), "p.txt: suffix: got '.txt', allowed: .png"),
        ((*GREY, "--plot", "nowhere/p.png"), "nowhere: no such directory to write to"),
        (("clean", "row.png", "o.png", "--tone-curve", "srgb"), "row.png: frames: got shape (1, 1, 40, 1), allowed: "),
        (("calibrate", "grey.png", "--frequency", "500Hz", "--pulses", "5%"), "grey.png: light: got shape (1, 50)"),
        (("receive",), "Missing argument 'FILE...'."),
        (("receive", "grey.png", "--chip-rate", "1kHz"), "--chip-rate: Hz needs --row-time"),
        (("exposure", "--comm", "500"), "Missing option '--sense'."),
        (("exposure", "--comm", "-500", "--sense", "5"), "Invalid value for '--comm': got -500 Hz"),
        (("exposure", "--comm", "500", "--sense", "5", "--bounds", "3ms"), "Invalid value for '--bounds': got '3ms'"),
    ],
)
def test_every_refusal_is_one_line_and_code_two(run, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    write_frames("grey.png", np.random.default_rng(0).integers(0, 255, (50, 40), dtype=np.uint8))
    (tmp_path / "half.png").write_bytes((tmp_path / "grey.png").read_bytes()[:700])
    write_frames("row.png", np.zeros((1, 40), np.uint8))
    (tmp_path / "empty.png").touch()
    (tmp_path / "text.png").write_text("not a picture")
    code, out, err = run(*arguments)
    assert (code, out, len(err)) == (2, [], 1)
    assert err[0].startswith(f"ocisac: {message}")
    assert sorted(os.listdir(tmp_path)) == ["empty.png", "grey.png", "half.png", "row.png", "text.png"]


def test_libraries_that_write_of_damage_are_silenced(program, tmp_path):
    from PIL import Image

    picture = np.random.default_rng(0).integers(0, 255, (50, 40), dtype=np.uint8)
    Image.fromarray(picture).save(tmp_path / "lzw.tif", compression="tiff_lzw")
    damaged = bytearray((tmp_path / "lzw.tif").read_bytes())
    damaged[8:12] = b"\xff" * 4  # codes of the LZW stream
    (tmp_path / "lzw.tif").write_bytes(damaged)
    done = program("gain", tmp_path / "lzw.tif", "--frequency", "0.1")
    assert done.returncode == 2
    assert done.stderr.startswith(f"ocisac: {tmp_path / 'lzw.tif'}: truncated or damaged picture")
    assert done.stderr.count("\n") == 1


def test_help_is_quick_to_load():
    code = "import sys; from ocisac_fast.cli import main; main(['--help']); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "Commands:" in done.stdout
    assert not {"PIL", "av", "matplotlib", "rich"} & set(done.stdout.split())


@pytest.mark.parametrize("missing", ["click", "rich"])
def test_missing_libraries_are_named(missing):
    code = f"import sys; sys.modules[{missing!r}] = None; from ocisac_fast.cli import main; sys.exit(main(['info']))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == f"ocisac: the command line needs {missing}: pip install {missing}\n"


def test_a_closed_pipe_is_quiet():
    command = f"{sys.executable} -m ocisac_fast.cli gain --help | true; exit ${{PIPESTATUS[0]}}"
    for _ in range(3):
        done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
        assert done.stderr == ""
        assert done.returncode in (0, 141)  # the help may fit into the pipe before it closes


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_is_quiet_and_leaves_no_half_file(tmp_path, number, code):
    light = ("--frequency", "500Hz", *TESTBED, "--frames", "100000", *DARK)
    command = [sys.executable, "-m", "ocisac_fast.cli", "simulate", *light, "-o", tmp_path / "long.mkv"]
    heard = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)  # noqa: E731 - a shell's background jobs ignore it
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, preexec_fn=heard, **pipes) as child:
        deadline = time.monotonic() + 60
        while not any(path.stat().st_size > 0 for path in tmp_path.iterdir()) and time.monotonic() < deadline:
            time.sleep(0.02)
        assert list(tmp_path.iterdir()), "the recording has begun"
        child.send_signal(number)
        out, err = child.communicate(timeout=60)
    assert (child.returncode, out, err) == (code, b"", b"")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform != "linux", reason="file names of any bytes")
def test_a_file_name_that_is_no_utf8_leaves_json_valid(program, tmp_path):
    name = os.fsdecode(os.fsencode(tmp_path) + b"/lamp\xff.png")
    write_frames(name, np.zeros((64, 48), np.uint8))
    utf8 = {"env": {**os.environ, "PYTHONUTF8": "1"}, "text": False, "check": True}
    done = program("receive", "--row-time", "22.2us", "--json", name, name, **utf8)
    lines = done.stdout.decode("utf-8").splitlines()  # strict
    assert [json.loads(line)["file"] for line in lines] == [f"{tmp_path}/lamp\\xff.png"] * 2
    assert plain({"file\udcff": ["\udcff"]}) == {"file\\xff": ["\\xff"]}
    done = program("gain", name + "\x1b[2J", "--row-time", "1us", "--frequency", "1Hz", text=False)
    assert done.returncode == 2
    assert b"\\udcff.png\\x1b[2J" in done.stderr


def test_standard_output_may_be_ascii(square, facts, program):
    words = ("gain", square("s.png"), "--frequency", "500Hz", *TESTBED, *SQUARE)
    wanted = facts(*words)
    for options, lines in ((), 3), (("--json",), 1):
        done = program(*words, *options, env={**os.environ, "PYTHONIOENCODING": "ascii"}, text=False)
        assert (done.returncode, done.stderr) == (0, b"")
        assert len(done.stdout.decode("ascii").splitlines()) >= lines
    assert json.loads(done.stdout) == wanted[0]


def test_the_reason_is_given_where_there_is_no_payload(run, chips):
    code, out, err = run("receive", chips, "--row-time", "22.2us", "--exposure", "60us", "--packets", "--json")
    assert (code, len(out)) == (0, 3)
    assert err == [
        "no payload in 3 frames: chips in 3 of them, but no header of a packet; --line-code, --block-bytes, "
        "--preamble, --chip-rate or --row-time may differ from the sender's; a block of 16 bytes is 302 chips, a frame "
        "shows 127: smaller blocks show more headers"
    ]


@pytest.mark.parametrize("title", ["source 0 against bits[/b].txt", "[bold]sent.txt", ":smile:.png", "a[red"])
def test_a_title_of_a_table_is_printed_as_it_is(title, capsys):
    emit_table(title, ["a", "b" * 40], [["1", "2"]])
    assert title in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("clean", "a.png", ""), "OUT"),
        (("demo", "--directory", ""), "--directory"),
        (("batch", "a.png", "-o", "", "detect"), "--output"),
        (("batch", "", "-o", "o", "detect"), "RECORDINGS..."),
        (("batch", "--summary", ""), "--summary"),
        (("gain", "", "--frequency", "0.1"), "FILE"),
        (("receive", "a.png", "--sent", ""), "--sent"),
    ],
)
def test_a_file_or_folder_without_a_name_is_refused(words, name, run, square, tmp_path, monkeypatch):
    """The folder was the working one."""
    square("a.png")
    monkeypatch.chdir(tmp_path)
    code, _, (line,) = run(*words)
    assert (code, line.partition(", ")[0]) == (2, f"ocisac: {name}: got no name")
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.parametrize("second", [np.s_[::2, ::2], np.s_[:100], np.s_[:, :9]])
@pytest.mark.parametrize("command", ["detect", "receive", "gain", "sense", "calibrate", "clean", "clean --still"])
def test_pages_of_two_sizes_are_no_recording(command, second, run, square, tmp_path):
    """The second was measured with the row time of the first."""
    page = read_frames(square("a.png")).frames[0]
    path = tmp_path / "pages.tif"
    first, other = (image.fromarray(np.ascontiguousarray(each)) for each in (page, page[second]))
    first.save(path, save_all=True, append_images=[other])
    words = {"gain": ["--frequency", "500Hz"], "calibrate": ["--frequency", "500Hz"]}
    name, *more = command.split()
    timing = [] if name == "calibrate" else ["--row-time", "22.2us"]
    outputs = [tmp_path / "out.tif"] if name == "clean" else []
    code, _, err = run(name, path, *outputs, *more, *words.get(name, []), *timing)
    assert code == 2
    assert f"{path}: frame 1 is {page[second].shape} after frames of {page.shape}" in err[-1]


def test_frames_longer_than_their_time_are_refused_before_the_first_is_printed(run, square):
    code, out, (line,) = run("receive", square("a.png"), "--packets", "--frame-rate", "30kHz", "--row-time", "22.2us")
    assert (code, out) == (2, [])
    assert "--frame-rate, --row-time: rows: got 720, allowed: 1 to as many as the frame time holds" in line


@pytest.mark.parametrize("command", ["gain", "detect", "receive", "sense", "calibrate", "clean"])
def test_values_that_are_no_numbers_are_errors_of_their_file(command, run, tmp_path):
    frames = np.full((200, 20), 100.0)
    frames[3, 4] = math.nan
    np.save(tmp_path / "a.npy", frames)
    more = {"gain": ("--frequency", "500"), "calibrate": ("--frequency", "500"), "clean": (tmp_path / "b.npy",)}
    code, _, err = run(command, tmp_path / "a.npy", *more.get(command, ()))
    assert (code, err[-1]) == (2, f"ocisac: {tmp_path / 'a.npy'}: columns: got nan, allowed: a finite number")
