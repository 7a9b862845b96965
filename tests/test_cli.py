"""The command line: units, geometry, what each command prints, and how it refuses."""

import json
import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("click")
pytest.importorskip("rich")
pytest.importorskip("PIL.Image")
pytest.importorskip("av")

from ocisac_fast.cli import main
from ocisac_fast.cli.output import plain, quantity, with_spread
from ocisac_fast.cli.pictures import PictureOptions, arrange
from ocisac_fast.cli.units import Quantity
from ocisac_fast.files import read_frames, write_frames

TESTBED = ("--row-time", "22.2us", "--exposure", "622us")


@pytest.fixture
def run(capsys, monkeypatch):
    """Runs the command line in this process: code, lines of standard output, lines of standard error."""
    import warnings

    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)  # put back after each run

    def call(*arguments):
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out.splitlines(), captured.err.splitlines()

    return call


@pytest.fixture
def facts(run):
    """Runs a command with --json, which must succeed: its objects."""

    def call(*arguments):
        code, out, err = run(*arguments, "--json")
        assert (code, err) == (0, [])
        return [json.loads(line, parse_constant=pytest.fail) for line in out]

    return call


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
    code, out, err = run("simulate", "--frequency", "1kHz", "--row-time", text)
    assert (code, out) == (2, [])
    assert err == [
        f"ocisac: Invalid value for '--row-time': got {text!r}, allowed: a number with or without unit, such as 9.2us"
    ]


@given(st.floats(1e-9, 1e9), st.sampled_from(["s", "Hz"]))
def test_what_is_printed_can_be_read_back(value, unit):
    assert float(Quantity.parse(quantity(value, unit, 9), unit)) == pytest.approx(value, rel=1e-8)


def test_json_knows_no_nan_and_no_numpy():
    record = {
        "a": np.float32(0.5),
        "b": math.nan,
        "c": [np.inf, np.int64(3)],
        "d": np.array([1, 2]),
        "e": np.bool_(True),
    }
    assert json.dumps(plain(record), allow_nan=False) == '{"a": 0.5, "b": null, "c": [null, 3], "d": [1, 2], "e": true}'


def test_a_spread_is_in_the_unit_of_its_value_or_finer():
    assert with_spread(9.2090395e-6, 1.2e-10, "s") == "9.20904 µs ± 0.12 ns"
    assert with_spread(0.5, math.nan, "") == "0.5"


# Geometry


def options(**changed):
    unknown = dict.fromkeys(("row_time", "exposure", "region", "tone_curve", "dark_level", "white_level"))
    return PictureOptions(
        **{**unknown, "scan_axis": "y", "channel": "auto", "waveform": "tone", "duty": 0.5, **changed}
    )


STORED = np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)


@pytest.mark.parametrize(
    ("changed", "want"),
    [
        ({}, STORED),
        ({"scan_axis": "-y"}, STORED[::-1]),
        ({"scan_axis": "x"}, STORED.transpose(1, 0, 2)),
        ({"scan_axis": "-x"}, STORED[:, ::-1].transpose(1, 0, 2)),
        ({"region": (2, 1, 4, 3)}, STORED[1:4, 2:6]),
        ({"region": (2, 1, 4, 3), "scan_axis": "-x"}, STORED[1:4, 5:1:-1].transpose(1, 0, 2)),
        ({"channel": "b"}, STORED[..., 2]),
        ({"channel": 1}, STORED[..., 1]),
        ({"region": (0, 0, 8, 6)}, STORED),
    ],
)
def test_geometry_is_a_view_of_what_is_stored(changed, want):
    arranged = arrange(STORED, options(**changed))
    assert np.array_equal(arranged, want)
    assert np.shares_memory(arranged, STORED)


def test_luma_is_the_weighted_sum():
    assert arrange(STORED, options(channel="y")) == pytest.approx(STORED @ np.array([0.299, 0.587, 0.114]))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"region": (1, 0, 8, 6)}, "--region: got 1,0,8,6, allowed: x,y,w,h inside the picture of 8 x 6 pixels"),
        ({"region": (0, 0, 8, 0)}, "--region: got 0,0,8,0"),
        ({"channel": 3}, "--channel: got 3, the picture has 3"),
    ],
)
def test_what_lies_outside_the_picture_is_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        arrange(STORED, options(**changed))


def test_a_grey_picture_has_no_red():
    with pytest.raises(ValueError, match="--channel: got r, the picture is grey"):
        arrange(STORED[..., 0], options(channel="r"))


# Simulation


def test_a_simulation_is_the_light_of_the_rows(facts, tmp_path):
    from ocisac_fast import Camera, SquareWave, integrate_exposure

    path = tmp_path / "rows.npy"
    light = ("--waveform", "square", "--frequency", "500Hz", "--duty", ".3", "--phase", "1")
    (printed,) = facts("simulate", *light, *TESTBED, "--rows", 300, "--columns", 4, "--bit-depth", "float", "-o", path)
    assert printed == {
        "file": str(path),
        "frames": 1,
        "rows": 300,
        "columns": 4,
        "dtype": "float32",
        "row_time_s": 22.2e-6,
        "exposure_s": 622e-6,
    }
    want = 200 * integrate_exposure(SquareWave(500, 0.3, phase=1), Camera(22.2e-6, 622e-6), 300)
    values = np.load(path)
    assert values.shape == (300, 4)
    assert np.allclose(values, want[:, np.newaxis], atol=1e-4)


def test_frames_follow_each_other_in_time(facts, tmp_path):
    from ocisac_fast import Camera, Chips, integrate_exposure

    path = tmp_path / "chips.mkv"
    light = ("--waveform", "chips", "--bits", "0110", "--chip-rate", "1.1kHz")
    facts(
        "simulate", *light, *TESTBED, "--rows", 99, "--columns", 8, "--frames", 3, "--frame-rate", "120Hz", "-o", path
    )
    camera = Camera(22.2e-6, 622e-6, 1 / 120)
    want = integrate_exposure(Chips("0110", 1100.0, repeat=True), camera, 99, frames=3)
    recording = read_frames(path)
    assert recording.frame_rate == pytest.approx(120)
    assert np.abs(recording.frames - 200 * want[..., np.newaxis]).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("depth", ["8", "16"])
def test_noise_is_repeatable_and_of_the_size_asked_for(facts, tmp_path, depth):
    values = ("--noise", "5", "--swing", "100", "--dark-level", "60", "--bit-depth", depth)
    for name, seed in (("a.png", 1), ("b.png", 1), ("c.png", 2)):
        facts("simulate", "--frequency", "500", *TESTBED, *values, "--seed", seed, "-o", tmp_path / name)
    a, b, c = (read_frames(tmp_path / name).frames[0].astype(float) for name in ("a.png", "b.png", "c.png"))
    assert np.array_equal(a, b)
    assert (a - c).std() == pytest.approx(5 * math.sqrt(2), rel=0.01)
    assert a.mean() == pytest.approx(110, abs=3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--frequency", "500", "--row-time", "22.2us"), "Missing option '--exposure'."),
        (TESTBED, "--waveform tone: needs --frequency"),
        (("--waveform", "chips", "--bits", "01", *TESTBED), "--waveform chips: needs --chip-rate"),
        (("--waveform", "chips", "--bits", "012", "--chip-rate", "1kHz", *TESTBED), "levels: got '012'"),
        (("--frequency", "-5", *TESTBED), "frequency: got -5"),
        (("--frequency", "nan", *TESTBED), "frequency: got nan"),
        (("--frequency", "5", "--row-time", "0", "--exposure", "1ms"), "row_time: got 0"),
        (("--frequency", "5", *TESTBED, "--noise", "-1"), "noise: got -1.0, allowed: finite, 0 or above"),
        (("--frequency", "5", *TESTBED, "--rows", "0"), "rows: got 0, allowed: from 1"),
        (("--frequency", "5", *TESTBED, "--rows", "99999", "--columns", "99999"), "rows x columns: got 99999 x 99999"),
        (("--frequency", "5", *TESTBED, "--frame-rate", "0"), "--frame-rate: got 0.0, allowed: above 0"),
        (("--frequency", "5", *TESTBED, "--bit-depth", "12"), "Invalid value for '--bit-depth'"),
    ],
)
def test_a_simulation_without_meaning_is_refused(run, tmp_path, arguments, message):
    code, out, err = run("simulate", *arguments, "-o", tmp_path / "x.png")
    assert (code, out, len(err)) == (2, [], 1)
    assert err[0].startswith(f"ocisac: {message}")
    assert os.listdir(tmp_path) == []


# Refusals in general


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nonsense",), "No such command 'nonsense'."),
    ],
)
def test_every_refusal_is_one_line_and_code_two(run, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    write_frames("grey.png", np.random.default_rng(0).integers(0, 255, (50, 40), dtype=np.uint8))
    (tmp_path / "half.png").write_bytes((tmp_path / "grey.png").read_bytes()[:700])
    (tmp_path / "empty.png").touch()
    (tmp_path / "text.png").write_text("not a picture")
    code, out, err = run(*arguments)
    assert (code, out, len(err)) == (2, [], 1)
    assert err[0].startswith(f"ocisac: {message}")
    assert sorted(os.listdir(tmp_path)) == ["empty.png", "grey.png", "half.png", "text.png"]


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
    assert done.stderr == f"ocisac: the command line needs {missing}: pip install 'ocisac-fast[cli]'\n"


def test_a_closed_pipe_is_quiet():
    command = f"{sys.executable} -m ocisac_fast.cli simulate --help | true; exit ${{PIPESTATUS[0]}}"
    for _ in range(3):
        done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
        assert done.stderr == ""
        assert done.returncode in (0, 141)  # the help may fit into the pipe before it closes


def test_an_interrupt_is_quiet(tmp_path):
    output = tmp_path / "long.mkv"
    command = [sys.executable, "-m", "ocisac_fast.cli", "simulate", "--frequency", "500", *TESTBED, "--frames", "9999"]
    child = subprocess.Popen([*command, "--noise", "2", "-o", output], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    while not list(tmp_path.iterdir()) and child.poll() is None:
        time.sleep(0.02)
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=30)
    assert (child.returncode, out, err) == (130, b"", b"")
    assert list(tmp_path.iterdir()) == []
