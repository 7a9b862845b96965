"""Row time from a lamp lit once a frame: recordings made by the exposure integral, real ones, refusals."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from ocisac_fast import Camera, SquareWave, integrate_exposure
from ocisac_fast.exposure import calibrate_pulses, pulse_bands

ROWS = 300


def recording(
    duty: float,
    *,
    row_time: float = 46e-6,
    exposure: float = 230e-6,
    gap_rows: float = 12.0,
    drift_rows: float = 1.1,
    noise: float = 0.02,
    frames: int = 420,
    spot: float | None = None,
) -> tuple[npt.NDArray[np.float64], float]:
    """(frames, rows) of a lamp that lights rows unevenly, and its frequency."""
    period = (ROWS + gap_rows + drift_rows) * row_time
    camera = Camera(row_time, exposure, (ROWS + gap_rows) * row_time)
    light = integrate_exposure(SquareWave(1 / period, duty=duty, phase=1.0), camera, ROWS, frames=frames)
    rows = np.arange(ROWS)
    profile = 3.0 + 2.0 * np.cos(rows / 40.0) if spot is None else np.exp(-(((rows - ROWS / 2) / (spot * ROWS)) ** 2))
    noises = np.random.default_rng(int(1e4 * duty)).normal(0.0, noise, light.shape)
    return light * profile + 4.0 + noises, 1 / period


@pytest.mark.parametrize("exposure", [100e-6, 230e-6, 400e-6])
@pytest.mark.parametrize("drift", [1.1, -0.83])
def test_row_time_exposure_and_pulses_from_two_duties(exposure: float, drift: float) -> None:
    made = [recording(duty, exposure=exposure, drift_rows=drift) for duty in (0.1, 0.3)]
    frequency = made[0][1]
    found = calibrate_pulses([light for light, _ in made], frequency, (0.1, 0.3))
    assert found.row_time == pytest.approx(46e-6, rel=1e-3)
    assert abs(found.row_time - 46e-6) < 3 * found.row_time_std
    assert found.row_time_std < 0.02 * 46e-6
    assert abs(found.offset) < 3 * found.offset_std + 1e-6  # a box adds nothing at half height
    assert found.exposure == pytest.approx(exposure, abs=max(3 * found.exposure_std, 0.1 * exposure))
    assert found.misfit < 0.03
    assert found.flags == ()
    assert np.allclose(found.pulse_widths, [0.1 / frequency, 0.3 / frequency], rtol=5e-3)


@pytest.mark.parametrize(("duties", "noise"), [((0.08, 0.25), 0.02), ((0.15, 0.35), 0.01), ((0.2, 0.4), 0.003)])
def test_a_spot_in_noise(duties: tuple[float, float], noise: float) -> None:
    """Rows beside a laser's spot hold noise, whose bands are none."""
    made = [recording(duty, noise=noise, spot=0.25) for duty in duties]
    found = calibrate_pulses([light for light, _ in made], made[0][1], duties)
    assert found.row_time == pytest.approx(46e-6, rel=3e-3)
    assert abs(found.row_time - 46e-6) < 3 * found.row_time_std
    for (light, frequency), duty in zip(made, duties, strict=True):
        alone = calibrate_pulses([light], frequency, [duty])
        assert abs(alone.row_time - 46e-6) < alone.row_time_std


def test_pulses_hardly_longer_than_the_exposure() -> None:
    """Most of their lit samples lie on ramps."""
    made = [recording(duty, exposure=650e-6, noise=0.005) for duty in (0.05, 0.15)]
    found = calibrate_pulses([light for light, _ in made], made[0][1], (0.05, 0.15))
    assert found.row_time == pytest.approx(46e-6, rel=5e-3)


@pytest.mark.parametrize("drift", [1.1, -3.0, 5.0])
def test_the_lamp_s_period_in_rows_needs_no_duty(drift: float) -> None:
    light, frequency = recording(0.3, drift_rows=drift)
    found = calibrate_pulses([light], frequency, [0.2])
    assert found.period_rows == pytest.approx(ROWS + 12 + drift, abs=0.15)
    assert abs(found.period_rows - (ROWS + 12 + drift)) < 3 * found.period_rows_std


def test_duties_that_are_not_the_lamp_s_are_flagged_and_widen_the_error() -> None:
    made = [recording(duty, noise=0.003) for duty in (0.1, 0.4)]
    lights, frequency = [light for light, _ in made], made[0][1]
    assert calibrate_pulses(lights, frequency, (0.1, 0.4)).flags == ()
    found = calibrate_pulses(lights, frequency, (0.105, 0.42))
    assert found.flags == ("period_misfit",)
    assert found.row_time == pytest.approx(1.05 * 46e-6, rel=3e-3)
    assert abs(found.row_time - 46e-6) < 1.5 * found.row_time_std


def test_an_exposure_longer_than_the_ramps_is_not_told() -> None:
    made = [recording(duty, exposure=1.2e-3) for duty in (0.15, 0.35)]
    found = calibrate_pulses([light for light, _ in made], made[0][1], (0.15, 0.35))
    assert found.row_time == pytest.approx(46e-6, rel=3e-3)
    assert math.isnan(found.exposure)
    assert math.isnan(found.exposure_std)


def test_pulses_split_across_frames_are_enough() -> None:
    made = [recording(duty) for duty in (0.2, 0.5)]
    bands = [pulse_bands(light) for light, _ in made]
    assert min(one.split.size for one in bands) > 20
    split = [replace(one, whole=np.zeros(0)) for one in bands]
    found = calibrate_pulses(split, made[0][1], (0.2, 0.5))
    assert found.row_time == pytest.approx(46e-6, rel=2e-3)
    assert math.isnan(found.offset)
    assert np.isnan(found.rows).all()


@pytest.mark.parametrize("duties", [(0.02, 0.04, 0.08), (0.03, 0.1)])
@pytest.mark.parametrize("exposure", [0.7e-3, 1e-3])
def test_pulses_shorter_than_the_exposure_are_flagged(duties: tuple[float, ...], exposure: float) -> None:
    """Their bands are as long as the exposure, whatever the duty."""
    made = [recording(duty, exposure=exposure, noise=0.003) for duty in duties]
    found = calibrate_pulses([light for light, _ in made], made[0][1], duties)
    assert "short_pulses" in found.flags


def test_rows_that_too_few_frames_show_lit_are_flagged() -> None:
    camera, lights = Camera(22.2e-6, 0.5e-3, 1 / 29.3), []
    for duty in (0.05, 0.1):
        light = integrate_exposure(SquareWave(60.0, duty=duty), camera, 720, frames=60)
        lights.append(20 + 180 * light + np.random.default_rng(1).normal(0, 0.3, light.shape))
    found = calibrate_pulses(lights, 60.0, (0.05, 0.1))
    assert "short_pulses" in found.flags


def test_one_duty_has_an_error_that_covers_the_offset() -> None:
    for offset in (-150e-6, 0.0, 150e-6):  # the lamp shines longer or shorter than its duty says
        light, frequency = recording(0.1 + 0.0)
        duty = 0.1 - offset * frequency
        found = calibrate_pulses([light], frequency, [duty])
        assert abs(found.row_time - 46e-6) < found.row_time_std
        assert math.isnan(found.offset)
    joint = calibrate_pulses([recording(d)[0] for d in (0.1, 0.25)], frequency, [0.1 - 0.01, 0.25 - 0.01])
    assert joint.row_time == pytest.approx(46e-6, rel=2e-3)
    assert joint.offset == pytest.approx(0.01 / frequency, rel=0.2)


def test_real_webcam(recordings: Path) -> None:
    """Five duties of one laser: every pair tells the same row time within 0.3 %, at 30.1 Hz 45.7 us."""
    from ocisac_fast.files import open_recording

    folder = recordings / "pulses"
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}")
    duties = (0.05, 0.1, 0.2, 0.3, 0.5)
    bands = []
    for duty in duties:
        with open_recording(folder / f"logitech_30.1hz_duty_{100 * duty:.0f}.mkv") as stream:
            bands.append(pulse_bands(np.array([frame.mean(axis=1) for frame in stream])))
    every = calibrate_pulses(bands, 30.1, duties)
    assert every.row_time == pytest.approx(45.70e-6, abs=3 * every.row_time_std)
    assert every.row_time_std < 0.003 * every.row_time
    assert 100e-6 < every.exposure < 350e-6
    assert every.misfit < 0.03
    for a, b in itertools.combinations(range(5), 2):
        pair = calibrate_pulses([bands[a], bands[b]], 30.1, [duties[a], duties[b]])
        assert pair.row_time == pytest.approx(every.row_time, rel=3e-3)
        assert abs(pair.row_time - every.row_time) < 2 * pair.row_time_std
    for one, duty in zip(bands, duties, strict=True):
        alone = calibrate_pulses([one], 30.1, [duty])
        assert abs(alone.row_time - every.row_time) < alone.row_time_std


def test_what_is_no_pulsed_lamp_is_flagged() -> None:
    """A lamp that fades in and out over a dozen rows and more."""
    light, frequency = recording(0.1)
    slow = np.apply_along_axis(lambda row: np.convolve(row, np.ones(60) / 60, "same"), 1, light)
    assert "model_misfit" in calibrate_pulses([slow], frequency, [0.1]).flags


def test_command(tmp_path: Path, run: Any, facts: Any) -> None:
    files = []
    for duty in (0.1, 0.3):
        light, frequency = recording(duty)
        files.append(tmp_path / f"{duty}.npy")
        np.save(files[-1], np.repeat(np.rint(20 * light)[..., np.newaxis], 8, axis=2).astype(np.uint8))
    arguments = ("--frequency", f"{frequency!r}Hz")
    (found,) = facts("calibrate", *files, *arguments, "--pulses", "10%,30%")
    assert found["row_time_s"] == pytest.approx(46e-6, rel=2e-3)
    assert found["flags"] == []
    (found,) = facts("calibrate", files[0], *arguments, "--pulses", "10%")
    assert found["flags"] == ["one_duty"]
    assert abs(found["row_time_s"] - 46e-6) < found["row_time_std_s"]
    for words, message in ((("--pulses", "10%"), "--pulses: got 1 duties"), ((), "FILE: got 2")):
        code, _, err = run("calibrate", *files, *arguments, *words)
        assert (code, message in err[-1]) == (2, True)


def test_the_command_reads_a_band_of_lit_rows_along_y(recordings: Path, run: Any) -> None:
    files = [recordings / "pulses" / f"logitech_30.1hz_duty_{duty}.mkv" for duty in (5, 50)]
    code, out, _ = run("calibrate", *files, "--frequency", "30.1Hz", "--pulses", "5%,50%", "--json")
    assert (code, json.loads(*out)["row_time_s"]) == (0, pytest.approx(45.7e-6, rel=0.01))
