"""Frequency search, calibration and the choice of columns and channel."""

import json
import pathlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ocisac_fast as oc
from ocisac_fast import Camera, Flag

PER_ROW = Camera(row_time=1.0)


def square_through_exposure(frequency, rows, exposure, phase=0.0, duty=0.5):
    """Exact mean of a 0/1 square wave over each row's exposure (rows); exposure in rows, above 0."""

    def antiderivative(cycles):
        return np.floor(cycles) * duty + np.minimum(cycles - np.floor(cycles), duty)

    end = frequency * np.arange(rows) + phase
    return (antiderivative(end) - antiderivative(end - frequency * exposure)) / (frequency * exposure)


def tone(frequency, rows, phase=0.0):
    return np.cos(2 * np.pi * frequency * np.arange(rows) + phase)


def bound_of_tone(frequency, rows, amplitude, sigma, trend_degree):
    """Cramér–Rao bound of the frequency of one tone beside a polynomial, all amplitudes unknown."""
    n = np.arange(rows)
    t = 2 * n / rows - 1
    phase = 2 * np.pi * frequency * n
    others = np.stack([*(t**d for d in range(trend_degree + 1)), np.cos(phase), np.sin(phase)], axis=1)
    slope = -2 * np.pi * n * amplitude * np.sin(phase)
    rest = slope - others @ np.linalg.lstsq(others, slope, rcond=None)[0]
    return sigma / np.linalg.norm(rest)


# --- real pictures ---------------------------------------------------------------------------------------------------


def entries(recordings, kind):
    return [entry for entry in json.loads((recordings / "recordings.json").read_text()) if kind in entry]


def channels_of(path: pathlib.Path):
    image = pytest.importorskip("PIL.Image")
    return list(np.moveaxis(np.asarray(image.open(path).convert("RGB")), -1, 0))


def test_tones_of_real_pictures(recordings):
    for entry in entries(recordings, "tone"):
        camera = Camera(entry["row_time_s"], entry.get("exposure_s"))
        channels = channels_of(recordings / entry["file"])
        best = channels[oc.pick_channel(channels, camera)]
        for waveform in ("auto", "tone", "square"):
            found = oc.find_frequency(best, camera, waveform=waveform)
            want = entry["tone"]
            assert found.frequency == pytest.approx(want["frequency_hz"], rel=want["tolerance"]), entry["file"]
            assert found.flags == 0
            assert 0 < found.frequency_std < want["tolerance"] * want["frequency_hz"]


def test_row_times_of_real_pictures(recordings):
    for entry in entries(recordings, "calibrate"):
        channels = channels_of(recordings / entry["file"])
        best = channels[oc.pick_channel(channels, PER_ROW)]
        want = entry["calibrate"]
        got = oc.calibrate(best, want["frequency_hz"])
        assert got.row_time == pytest.approx(want["row_time_s"], rel=want["tolerance"]), entry["file"]
        assert got.flags == 0
        assert 0 < got.row_time_std < want["tolerance"] * want["row_time_s"]


# --- known light -----------------------------------------------------------------------------------------------------


@settings(max_examples=50)
@given(
    rows=st.sampled_from([97, 251, 720, 1080]),
    place=st.floats(0, 1),
    phase=st.floats(0, 1),
    exposure=st.floats(0.2, 4),
    square=st.booleans(),
    noise=st.sampled_from([0.02, 0.1, 0.3]),
    seed=st.integers(0, 2**32 - 1),
)
def test_finds_any_frequency(rows, place, phase, exposure, square, noise, seed):
    frequency = 1.2 / rows * (0.49 * rows / 1.2) ** place  # from 1.2 cycles in the frame to 0.49 a row
    if square:
        exposure = min(exposure, 0.4 / frequency)  # a longer one makes the fundamental small
        light = square_through_exposure(frequency, rows, exposure, phase)
    else:
        light = 0.5 + 0.5 * tone(frequency, rows, 2 * np.pi * phase)
    columns = light[:, np.newaxis] * [100.0, 80.0, 60.0, 90.0]
    columns += np.random.default_rng(seed).normal(0, noise * 50, columns.shape)
    found = oc.find_frequency(columns, PER_ROW)
    assert not found.flags & Flag.NO_TONE
    # Harmonics above half the row rate fold back on a square wave: an interference, not noise.
    folded = 0.05 / rows if square and 3 * frequency > 0.5 / exposure / 4 else 0
    assert abs(found.cycles_per_row - frequency) < 6 * found.cycles_per_row_std + folded


@pytest.mark.parametrize(("rows", "cycles"), [(200, 8.3), (200, 1.4), (720, 30.7), (300, 0.31 * 300)])
def test_spread_is_that_of_the_bound_and_of_the_standard_error(rows, cycles):
    trials, sigma, frequency = 600, 0.4, cycles / rows
    random = np.random.default_rng(7)
    errors, stds = np.empty(trials), np.empty(trials)
    for i in range(trials):
        columns = 1 + tone(frequency, rows, random.uniform(0, 2 * np.pi))[:, np.newaxis] * [1.0, 0.7]
        columns += random.normal(0, sigma, columns.shape)
        found = oc.find_frequency(columns, PER_ROW, waveform="tone")
        errors[i], stds[i] = found.cycles_per_row - frequency, found.cycles_per_row_std
    amplitude = np.hypot(1, 0.7)
    degree = 0 if cycles < 2 else 2
    mean_information = np.mean(
        [1 / bound_of_tone(frequency, rows, amplitude, sigma, degree) ** 2]
        if cycles > 2
        else [1 / _bound_at_phase(frequency, rows, amplitude, sigma, p) ** 2 for p in np.linspace(0, np.pi, 40)]
    )
    spread = np.sqrt(np.mean(errors**2))
    assert abs(np.mean(errors)) < 4 * spread / np.sqrt(trials)
    assert spread == pytest.approx(1 / np.sqrt(mean_information), rel=0.1)
    assert np.sqrt(np.mean(stds**2)) == pytest.approx(spread, rel=0.1)


def _bound_at_phase(frequency, rows, amplitude, sigma, phase):
    n = np.arange(rows)
    turn = 2 * np.pi * frequency * n
    others = np.stack([np.ones(rows), np.cos(turn), np.sin(turn)], axis=1)
    slope = -2 * np.pi * n * amplitude * np.sin(turn + phase)
    rest = slope - others @ np.linalg.lstsq(others, slope, rcond=None)[0]
    return sigma / np.linalg.norm(rest)
