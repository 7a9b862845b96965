"""Limits of lamps as they are filmed: mains hum, texture, tilt, a lamp in a part of the rows.

The plain methods and the library's kernels know the chips and their clock, as the receiver does once it has read them.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.light.waveforms import integrate_exposure
from ocisac_fast.packets.transmission import transmit
from ocisac_fast.scene.simulation import lamp_bar, texture
from studies.chart.scenes import Float64s
from studies.limits.catalogue import Point, limit, rms

_ROWS, _CAMERA = 1080, Camera(22.2e-6, 622e-6, 1 / 30)
_SLOW, _SMOOTH = 0.012, 56  # cycles per row; rows
_NOISE = 0.01  # of the swing
_COLUMNS, _BLOCK = 320, 8


def _chips(frames: int, seed: int) -> Float64s:
    """Exposed Manchester chips of 8 kHz, (frames, rows), 0 to 1."""
    sent = transmit(np.random.default_rng(seed).bytes(200)).waveform(8e3)
    return np.asarray(integrate_exposure(sent, _CAMERA, _ROWS, start=1.0 + seed, frames=frames))


@limit(
    "hum",
    "Mains hum under chips",
    sweep="hum, peak to peak / swing",
    error="RMS error of the rows / swing",
    plain="fit of a constant and the chips",
    why="Light of 100 Hz is 2.4 cycles of the frame here: it lifts some chips over the threshold and others below it.",
    then="The receiver fits slow light, and tones of other lamps, beside the chips. Half cosines leave a few percent "
    "of the hum at the frame's ends.",
    spot=0.5,
    fails_by=0.1,
    good=0.02,
)
def _hum() -> list[Point]:
    points = []
    for share in (0.05, 0.1, 0.2, 0.5, 1.0):
        plain, library = [], []
        for seed, exposed in enumerate(_chips(6, 1)):
            random = np.random.default_rng(seed)
            angles = 2 * np.pi * (100 * _CAMERA.row_period * np.arange(_ROWS) + random.uniform())
            signal = exposed + share / 2 * np.sin(angles) + _NOISE * random.standard_normal(_ROWS)
            found = _core.remove_nuisance(signal, _SLOW, [], exposed)
            assert found is not None
            plain.append(np.std(signal - exposed))
            library.append(np.std(np.asarray(found[0]) - exposed))
        points.append(Point(share, _without_noise(plain), _without_noise(library), math.nan))
    return points


def _without_noise(deviations: list[np.floating]) -> float:
    return math.sqrt(max(rms(np.array(deviations)) ** 2 - _NOISE**2, 0.0))


@limit(
    "wall-texture",
    "Texture of a lit wall",
    sweep="standard deviation of its logarithm",
    error="RMS relative error of the swing",
    plain="one swing for all rows",
    why="Reflectance scales the light of each row; chips of dark rows stay below the threshold.",
    then="The receiver learns dark level and swing of each row from frame to frame; here from 12 frames, whose noise "
    "the standard error holds. Until then frames are read with polynomials.",
    spot=0.1,
    fails_by=0.05,
    good=0.02,
)
def _wall_texture() -> list[Point]:
    exposed = _chips(12, 2)
    noise = _NOISE * np.random.default_rng(3).standard_normal(exposed.shape)
    points = []
    for contrast in (0.03, 0.1, 0.2, 0.3, 0.5):
        swing = texture(_ROWS, 64, contrast, seed=4).mean(axis=1)
        signals = 0.3 * swing + swing * exposed + noise
        first = _core.first_profile(list(signals), _SMOOTH)
        assert first is not None
        fitted = _core.fit_profile(list(signals), list(exposed), first[1], _SMOOTH, 0.01)
        assert fitted is not None
        stated = rms(_NOISE / swing / np.sqrt(np.sum((exposed - exposed.mean(axis=0)) ** 2, axis=0)))
        plain = float(np.std(swing / swing.mean()))
        points.append(Point(contrast, plain, rms(np.asarray(fitted[1]) / swing - 1), stated))
    return points


@limit(
    "oblique-lamp",
    "A tilted bar",
    sweep="tilt, degrees",
    error="noise of the rows / best − 1",
    plain="one weight for each column",
    why="A column sees the bar in a part of its rows, and only noise in the others.",
    then="The receiver measures the slope from the swing of groups of columns, and combines along it.",
    spot=10.0,
    fails_by=0.5,
    good=0.05,
)
def _oblique_lamp() -> list[Point]:
    exposed = _chips(1, 5)[0][:, None]
    points = []
    for degrees in (1.0, 3.0, 6.0, 10.0, 15.0):
        lamp = lamp_bar(_ROWS, _COLUMNS, 16.0, tilt=math.radians(degrees))
        frame = lamp * exposed + 0.02 * np.random.default_rng(6).standard_normal(lamp.shape)
        blocks = frame.reshape(_ROWS, -1, _BLOCK).mean(axis=2).T
        swings = blocks - np.stack([np.convolve(block, np.ones(61) / 61, "same") for block in blocks])
        slope = _core.lamp_slope(swings, _BLOCK * (np.arange(len(blocks)) + 0.5) - 0.5)
        shifts = np.rint(slope * (np.arange(_ROWS) - (_ROWS - 1) / 2)).astype(int)
        columns = (np.arange(_COLUMNS) + shifts[:, None]) % _COLUMNS
        upright = np.take_along_axis(lamp, columns, axis=1)
        points.append(Point(degrees, _noise_over_best(lamp), _noise_over_best(upright), math.nan))
    return points


def _noise_over_best(lamp: Float64s) -> float:
    """Noise of the rows with one weight for each column, its mean light, over that with the best weights, less 1."""
    weights = lamp.mean(axis=0)
    noise = np.sqrt(np.sum(weights**2)) / (lamp @ weights)
    return float(rms(noise * np.sqrt(np.sum(lamp**2, axis=1)))) - 1


@limit(
    "part-of-rows",
    "A lamp in a part of the rows",
    sweep="share of the rows",
    error="rows that are not the lamp's / rows",
    plain="all rows are the lamp's",
    why="Chips are detected in dark rows too: bits that nobody sent.",
    then="Steady rows at the ends count as dark where they are far more than the light's longest run, or where no "
    "column shows the light. Without that hint, as here, fewer are read as dark chips: the silent points.",
    spot=0.5,
    fails_by=0.4,
    good=0.03,
    silent=(0.8, 0.9),
)
def _part_of_rows() -> list[Point]:
    points = []
    for share in (0.3, 0.5, 0.7, 0.8, 0.9):
        first, last = round(_ROWS * (1 - share) / 2), round(_ROWS * (1 + share) / 2)
        inside = (np.arange(_ROWS) >= first) & (np.arange(_ROWS) < last)
        errors = []
        for seed, exposed in enumerate(_chips(6, 7)):
            signal = inside * exposed + _NOISE * np.random.default_rng(seed).standard_normal(_ROWS)
            (begin, end), _ = _core.lit_rows(signal, _NOISE, (0, _ROWS))
            found = (np.arange(_ROWS) >= begin) & (np.arange(_ROWS) < end)
            errors.append(np.mean(found != inside))
        points.append(Point(share, 1 - share, rms(errors), math.nan))
    return points


@limit(
    "short-lamp",
    "Outline of a short lamp",
    sweep="cycles in the lamp",
    error="RMS error of its height / height",
    plain="where the swing exceeds 15 % of the largest",
    why="The swing at a row is that of a window of two cycles, which looks beyond the lamp by one.",
    then="`detect_sources` fits outline and tone of a lamp of at most 12 cycles alternately: its rows are those that "
    "the tone explains better than texture and than what lies around.",
    spot=3.0,
    fails_by=0.25,
    good=0.04,
)
def _short_lamp() -> list[Point]:
    rows, groups, height = np.arange(200), np.arange(12), 60
    points = []
    for cycles in (2.5, 3.0, 3.5, 4.5, 6.0, 8.0, 12.0):
        errors = []
        for seed in range(12):
            random = np.random.default_rng(seed)
            first = int(random.integers(70, 79))
            lit = ((rows >= first) & (rows < first + height))[:, None] & (groups >= 2) & (groups < 10)
            tone = np.cos(2 * np.pi * cycles / height * rows + seed)[:, None]
            light = np.where(lit, 0.5 + tone, np.cumsum(0.05 * random.standard_normal(lit.shape), axis=0))
            light += 0.05 * random.standard_normal(lit.shape)
            wide = _swinging_rows(light[:, 3:9].mean(axis=1), cycles / height)
            found = _core.fit_outline(light, wide[:, None] & (groups >= 1) & (groups < 11), cycles / height)
            assert found is not None
            errors.append([own.sum() / height - 1 for own in (wide, found[1].any(axis=1))])
        of_swing, of_outline = np.transpose(errors)
        points.append(Point(cycles, rms(of_swing), rms(of_outline), math.nan))
    return points


def _swinging_rows(signal: Float64s, frequency: float) -> npt.NDArray[np.bool_]:
    """Rows around the largest swing at a frequency, under a Hann window of two cycles, above 15 % of it."""
    window = np.hanning(2 * round(1 / frequency) + 3)
    window /= window.sum()
    fast = signal - np.convolve(signal, window, "same")
    swing = np.abs(np.convolve(fast * np.exp(-2j * np.pi * frequency * np.arange(len(signal))), window, "same"))
    faint = np.flatnonzero(swing < 0.15 * swing.max())
    largest = int(np.argmax(swing))
    rows = np.arange(len(signal))
    return np.asarray((rows > max(faint[faint < largest])) & (rows < min(faint[faint > largest])))
