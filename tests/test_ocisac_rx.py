"""The C++ executable, run as a process: raw frames in, JSON lines out."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera, Chips, Flag, SquareWave, _core

ROOT = Path(__file__).resolve().parents[1]
ROW_TIME, EXPOSURE, ROWS, COLUMNS = 22.2e-6, 400e-6, 720, 40


@pytest.fixture(scope="module")
def receiver():
    """The executable that OCISAC_RX names (`make test` does), else the newest of this tree's builds."""
    built = sorted(ROOT.glob("build/**/ocisac-rx"), key=os.path.getmtime)
    found = os.environ.get("OCISAC_RX") or (str(built[-1]) if built else shutil.which("ocisac-rx"))
    if found is None:
        pytest.skip("ocisac-rx is not built")
    return found


def run(receiver, frames, *options):
    command = [receiver, "--size", f"{COLUMNS}x{ROWS}", "--row-time", "22.2us", "--exposure", "400us", *options]
    return subprocess.run(command, input=frames, capture_output=True, timeout=60, check=False)


def recording(waveform, dtype="uint8", frames=3, scale=200):
    """(frames, rows, columns) of noisy frames."""
    camera = Camera(ROW_TIME, EXPOSURE, frame_time=1 / 30)
    light = ocisac.integrate_exposure(waveform, camera, ROWS, frames=frames)
    noise = np.random.default_rng(2).standard_normal((frames, ROWS, COLUMNS))
    return np.rint((scale / 10 + scale * light)[:, :, None] + scale / 100 * noise).astype(dtype)


@pytest.mark.parametrize(("dtype", "name", "scale"), [("uint8", "gray8", 200), ("<u2", "gray16le", 40000)])
@pytest.mark.parametrize("frequency", ["500Hz", None])
def test_gains_are_those_of_the_library(receiver, dtype, name, scale, frequency):
    frames = recording(SquareWave(500.0, phase=0.3), dtype, scale=scale)
    told = [] if frequency is None else ["--frequency", frequency]
    options = ["--waveform", "square", "--dark-level", str(scale / 10), "--no-bits", "--format", name, *told]
    done = run(receiver, frames.tobytes(), *options)
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [line["frame"] for line in lines] == [0, 1, 2]
    camera = Camera(ROW_TIME, EXPOSURE, dark_level=scale / 10)
    for line, frame in zip(lines, frames, strict=True):
        assert line["gain"]["frequency_hz"] == pytest.approx(500, rel=1e-3)
        want = ocisac.tone_gain(frame, camera, line["gain"]["frequency_hz"], waveform="square", pooled=True)
        assert line["gain"]["gain"] == pytest.approx(float(want.gain), rel=1e-9)
        assert line["gain"]["gain_std"] == pytest.approx(float(want.gain_std), rel=1e-6)
        assert line["gain"]["gain"] == pytest.approx(abs(np.sinc(500 * EXPOSURE)), abs=0.02)


def test_bits_are_those_that_were_sent(receiver):
    bits = "".join(np.random.default_rng(4).choice(["0", "1"], 500))
    frames = recording(Chips(bits, 2000.0), frames=1)
    line = json.loads(run(receiver, frames.tobytes(), "--frequency", "500Hz").stdout)
    assert len(line["received"]["bits"]) >= int(ROWS * ROW_TIME * 2000) - 2
    assert line["received"]["bits"] in bits
    assert line["received"]["chip_rate_hz"] == pytest.approx(2000, rel=5e-3)


def test_a_torn_frame_is_told_and_what_came_before_is_kept(receiver):
    frames = recording(SquareWave(500.0)).tobytes()
    done = run(receiver, frames[:-7], "--frequency", "500Hz")
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) == 2
    assert done.stderr.decode().strip() == "ocisac-rx: frame 2 is torn: 28793 of 28800 bytes; left out"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--size", "0x5"], "--size: got 0x5, allowed: WIDTHxHEIGHT"),
        (["--size", "axb"], "--size: got axb"),
        (["--size", "99999x99999"], "allowed: frames of at most 2^30 bytes"),
        (["--row-time", "0"], "--row-time: got 0"),
        (["--row-time", "22parsec"], "--row-time"),
        (["--exposure", "-1us"], "exposure: got -1e-06, allowed: a finite number, 0 or above"),
        (["--frequency", "0"], "frequency: got 0"),
        (["--frequency", "nan"], "--frequency: nan"),
        (["--format", "rgb"], "--format"),
        (["--nonsense"], "--nonsense"),
        (["/nonexistent"], "input: got /nonexistent"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(receiver, options, message):
    done = run(receiver, bytes(ROWS * COLUMNS), *options)
    assert done.returncode == 2
    assert done.stdout == b""
    assert done.stderr.decode().count("\n") == 1
    assert message in done.stderr.decode()


def test_an_empty_input_is_refused(receiver):
    done = run(receiver, b"")
    assert (done.returncode, done.stderr) == (2, b"ocisac-rx: no frames: the input is empty\n")


def test_a_dark_frame_is_answered_with_flags(receiver):
    line = json.loads(run(receiver, bytes(ROWS * COLUMNS)).stdout)
    assert line["gain"]["gain"] is None
    assert line["received"]["bits"] == ""
    assert line["received"]["flags"]


def test_flags_have_the_same_names_in_python_and_cpp():
    for bit in Flag:
        assert _core.flag_names(int(bit)) == Flag(bit).names()
    assert len(_core.flag_names(0xFFFFFFFF)) == len(list(Flag))
