"""Limits of stored values: clipping, tone curves, waveforms, quantisation, no light."""

from __future__ import annotations

import dataclasses

import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.light.waveforms import SquareWave, integrate_exposure
from ocisac_fast.tones.gain import tone_gain
from studies.chart.scenes import Scene
from studies.limits.catalogue import Point, compared, limit
from studies.limits.plain_methods import fitted_gain, rounded_bin_gain, transform_gain

_BASE = Scene("limits", "", 12.0, rows=720, columns=200)


@limit(
    "clipping",
    "Clipping",
    sweep="peak of the light, DN",
    error="RMS error of the gain",
    plain="the paper's bin, here on a bin",
    why="Above the top of the scale the crests are cut off: amplitude and mean both fall, and nothing in the number "
    "shows it.",
    then="The same number, with SATURATED: what was cut off is not in the data.",
    spot=320,
    fails_by=0.03,
    good=0.005,
    flags=Flag.SATURATED,
)
def _clipping() -> list[Point]:
    points = []
    for peak in (180, 230, 260, 290, 320, 400, 600):
        scene = dataclasses.replace(_BASE, mean=peak / 1.504)
        frame = next(scene.frames(1))
        found = tone_gain(frame, scene.camera, scene.frequency)
        points.append(compared(peak, scene.gain, rounded_bin_gain(scene, frame), found))
    return points


@limit(
    "saturated-core",
    "A saturated core",
    sweep="share of columns that saturate",
    error="RMS error of the gain",
    plain="the paper's bin of the mean over all columns",
    why="The middle of a lamp is brightest, weighs most and is cut off.",
    then="`pooled=True` leaves saturated columns out while others remain; SATURATED where none does.",
    spot=0.4,
    fails_by=0.02,
    good=0.005,
    flags=Flag.SATURATED,
)
def _saturated_core() -> list[Point]:
    points = []
    for share in (0.0, 0.1, 0.2, 0.4, 0.7, 0.95, 1.0):
        random = np.random.default_rng(7)
        brightness = np.where(np.arange(40) < share * 40, 3.5, 1.0)
        light = _BASE.light(random.random(30)).T[:, :, None] * brightness  # (frames, rows, columns)
        frames = np.clip(np.rint(light + 2.0 * random.standard_normal(light.shape)), 0, 255).astype(np.uint8)
        found = tone_gain(frames, _BASE.camera, _BASE.frequency, pooled=True)
        plain = rounded_bin_gain(_BASE, frames.mean(axis=2).T)
        points.append(compared(share, _BASE.gain, plain, found))
    return points


@limit(
    "ambient",
    "Ambient light",
    sweep="ambient light / source",
    error="RMS error of the gain",
    plain="the paper's bin over the mean, here on a bin",
    why="The mean is not the source's alone, and the ratio reads the source's share of it; so does a dark level.",
    then="`background=` and `dark_level=` subtract what is given. Other light cannot be estimated from the column and "
    "is not flagged: the gain is then share times |sinc|.",
    spot=1.0,
    fails_by=0.2,
    good=0.005,
)
def _ambient() -> list[Point]:
    points = []
    for ratio in (0.0, 0.03, 0.1, 0.3, 1.0, 2.0):
        random = np.random.default_rng(14)
        scene = dataclasses.replace(_BASE, mean=60.0)
        light = scene.light(random.random(200)) + 60.0 * ratio + 2.0 * random.standard_normal((scene.rows, 200))
        frame = np.clip(np.rint(light), 0, 255).astype(np.uint8)
        found = tone_gain(frame, scene.camera, scene.frequency, background=60.0 * ratio)
        points.append(compared(ratio, scene.gain, rounded_bin_gain(scene, frame), found))
    return points


@limit(
    "gamma",
    "Gamma",
    sweep="gamma of the picture",
    error="RMS error of the gain",
    plain="the paper's bin on stored values, here on a bin",
    why="Stored values are not light: the curve lifts the dark, so that swing over mean reads low.",
    then="`Camera(tone_curve=…, gamma=…)` inverts the curve first.",
    spot=2.2,
    fails_by=0.15,
    good=0.005,
)
def _gamma() -> list[Point]:
    points = []
    for gamma in (1.0, 1.2, 1.5, 1.8, 2.2, 2.6):
        random = np.random.default_rng(8)
        light = (_BASE.light(random.random(_BASE.columns)) + 10.0) / 255.0  # 10 DN of ambient light, given below
        stored = 255.0 * light ** (1.0 / gamma) + random.standard_normal(light.shape)
        frame = np.clip(np.rint(stored), 0, 255).astype(np.uint8)
        camera = Camera(_BASE.row_time, _BASE.camera.exposure, tone_curve="gamma", gamma=gamma)
        found = tone_gain(frame, camera, _BASE.frequency, background=10.0)
        flat = frame - 255.0 * (10.0 / 255.0) ** (1.0 / gamma)
        points.append(compared(gamma, _BASE.gain, rounded_bin_gain(_BASE, flat), found))
    return points


@limit(
    "duty",
    "PWM duty other than half",
    sweep="duty",
    error="RMS error of the gain",
    plain="the paper's bin times π/4, the ratio of a 50 % square wave",
    why="The fundamental of a pulse train of duty d is 2·sin(πd)/(πd) of its mean, between 2 and 0.",
    then="`duty=` sets that ratio, and the fit has the even harmonics of a duty other than half.",
    spot=0.2,
    fails_by=0.3,
    good=0.01,
)
def _duty() -> list[Point]:
    points = []
    for duty in (0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95):
        scene = dataclasses.replace(_BASE, exposure_cycles=0.3, waveform="square")
        random = np.random.default_rng(9)
        phases = random.uniform(-np.pi, np.pi, 50)
        rows = [
            integrate_exposure(SquareWave(scene.frequency, duty=duty, amplitude=1, phase=p), scene.camera, scene.rows)
            for p in phases
        ]
        light = 20.0 + 200.0 * np.stack(rows, axis=1) + 2.0 * random.standard_normal((scene.rows, 50))
        frame = np.clip(np.rint(light), 0, 255).astype(np.uint8)
        found = tone_gain(frame, scene.camera, scene.frequency, waveform="square", duty=duty, background=20.0)
        points.append(compared(duty, scene.gain, rounded_bin_gain(scene, frame - 20.0), found))
    return points


@limit(
    "constant",
    "Constant columns",
    sweep="level, DN",
    error="RMS gain that is read",
    plain="Fourier sum over the mean",
    why="A sum over noise is never 0, and over a dark mean it is a large gain; of exactly 0 it is 0/0.",
    then="Subtracts the noise's share from the magnitude: WEAK, and NaN with NO_LIGHT where the mean is not above 0.",
    spot=1,
    fails_by=0.03,
    good=1e-3,
    flags=Flag.WEAK | Flag.NO_LIGHT,
)
def _constant() -> list[Point]:
    points = []
    for level in (0.3, 1, 3, 10, 30, 100):
        noise = np.random.default_rng(10).standard_normal((_BASE.rows, _BASE.columns))
        frame = np.clip(np.rint(level + noise), 0, 255).astype(np.uint8)
        found = tone_gain(frame, _BASE.camera, _BASE.frequency)
        points.append(compared(level, 0.0, transform_gain(_BASE, frame), found))
    return points


@limit(
    "faint",
    "Quantisation of a faint signal",
    sweep="amplitude, DN",
    error="RMS error / amplitude",
    plain="fit of mean and tone, no noise in the rows",
    why="Without noise a swing below half a step stays on one code or jumps between two: rounding is no noise then but "
    "a function of the light.",
    then="WEAK where it stays on one code, QUANTISED where rounding may pull the gain by more than the standard error. "
    "With noise of half a step or more rounding is noise, and the answer right.",
    spot=0.1,
    fails_by=0.5,
    good=0.1,
    flags=Flag.WEAK | Flag.QUANTISED,
)
def _faint() -> list[Point]:
    points = []
    for amplitude in (0.03, 0.1, 0.3, 1.0, 3.0, 10.0):
        random = np.random.default_rng(11)
        scene = dataclasses.replace(_BASE, cycles=12.37, depth=amplitude / 100.0, exposure_cycles=1e-3)
        offset = random.random(200)  # uniform between two codes
        frame = np.rint(scene.light(random.random(200)) + offset).astype(np.uint8)
        found = tone_gain(frame, scene.camera, scene.frequency)
        truth = amplitude / (100.0 + offset)
        points.append(compared(amplitude, truth, fitted_gain(scene, frame), found, 100.0 / amplitude))
    return points
