"""Limits of frequency and sampling: nulls, few cycles, aliases, bins, neighbours, drift, gradient."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.tones.frequency import find_frequency
from ocisac_fast.tones.gain import tone_gain
from ocisac_fast.tones.varying_tone import varying_tone_gain
from studies.chart.scenes import Float64s, Scene
from studies.limits.catalogue import Point, compared, limit, rms, shared_flags
from studies.limits.plain_methods import fitted_gain, peak_frequency, rounded_bin_gain, transform_gain

_BASE = Scene("limits", "", 12.0, rows=720, columns=200)


def _frame(scene: Scene) -> npt.NDArray[np.uint8]:
    return next(scene.frames(1))


@limit(
    "null-gain",
    "Sinc null: gain",
    sweep="distance of f·T_e from 1",
    error="RMS error of the depth",
    plain="Fourier sum over |sinc(f·T_e)|, to get the depth of the light",
    why="Around whole f·T_e the exposure averages the tone away; what is left in the sum is noise, and the division "
    "blows it up.",
    then="Estimates the noise's share and subtracts it from the magnitude; NEAR_NULL below |sinc| = 0.05, WEAK below "
    "three "
    "standard errors.",
    spot=1e-4,
    fails_by=5.0,
    good=0.05,
    flags=Flag.NEAR_NULL | Flag.WEAK,
)
def _null_gain() -> list[Point]:
    points = []
    for distance in (1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3):
        scene = dataclasses.replace(_BASE, exposure_cycles=1.0 + distance)
        frame = _frame(scene)
        found = tone_gain(frame, scene.camera, scene.frequency)
        points.append(compared(distance, scene.gain, transform_gain(scene, frame), found, 1.0 / scene.gain))
    return points


@limit(
    "few-cycles",
    "Less than one cycle in the frame",
    sweep="cycles in the frame",
    error="RMS error of the gain",
    plain="Fourier sum at the exact frequency",
    why="A part of a cycle is not orthogonal to the mean, which leaks into the sum.",
    then="Fits mean and tone together; the standard error grows as they become alike. FEW_CYCLES below one cycle.",
    spot=0.4,
    fails_by=0.3,
    good=0.02,
    flags=Flag.FEW_CYCLES,
)
def _few_cycles() -> list[Point]:
    points = []
    for cycles in (0.1, 0.2, 0.4, 0.7, 1.2, 1.6, 2.4, 4.3):
        scene = dataclasses.replace(_BASE, cycles=cycles)
        frame = _frame(scene)
        found = tone_gain(frame, scene.camera, scene.frequency)
        points.append(compared(cycles, scene.gain, transform_gain(scene, frame), found))
    return points


@limit(
    "few-cycles-frequency",
    "Frequency from few cycles",
    sweep="cycles in the frame",
    error="RMS error, cycles/frame",
    plain="the highest bin beside the mean",
    why="Bins are a whole cycle apart, and those next to the mean hold its mirror images too.",
    then="`find_frequency` fits trend, tone and harmonics of one frequency; FEW_CYCLES below two, where a trend is "
    "fitted as a part of the tone. Below one it searches only with `bounds=`: NO_TONE.",
    spot=1.5,
    fails_by=0.3,
    good=0.02,
    flags=Flag.FEW_CYCLES | Flag.NO_TONE,
)
def _few_cycles_frequency() -> list[Point]:
    random = np.random.default_rng(15)
    points = []
    for cycles in (0.6, 1.1, 1.5, 2.2, 3.4, 5.5, 11.3):
        scene = dataclasses.replace(_BASE, cycles=cycles, columns=4)
        lights = [np.tile(scene.light([phase]), 4) for phase in random.random(24)]
        frames = [light + scene.noise * random.standard_normal(light.shape) for light in lights]
        found = [find_frequency(frame, Camera(1.0), waveform="tone") for frame in frames]
        plain = np.array([np.median(peak_frequency(frame)) for frame in frames])
        flags = shared_flags(np.array([int(one.flags) for one in found], np.uint32))
        stated = scene.rows * rms([one.frequency_std for one in found])
        error = rms(scene.rows * np.array([one.frequency for one in found]) - cycles)
        points.append(Point(cycles, rms(scene.rows * plain - cycles), error, stated, flags))
    return points


@limit(
    "harmonics",
    "Harmonics of a square wave",
    sweep="cycles in the frame",
    error="RMS error of the gain",
    plain="fit of mean and tone",
    why="At few cycles the harmonics are not orthogonal to the fundamental and leak into it.",
    then='`waveform="square"` fits every harmonic below half the row rate, for the same three row weights.',
    spot=1.7,
    fails_by=0.01,
    good=0.003,
    flags=Flag.HARMONICS_DROPPED,
)
def _harmonics() -> list[Point]:
    points = []
    for cycles in (1.2, 1.7, 2.3, 3.7, 6.3, 12.3):
        scene = dataclasses.replace(_BASE, cycles=cycles, exposure_cycles=0.1, depth=0.9, waveform="square")
        frame = _frame(scene)
        found = tone_gain(frame, scene.camera, scene.frequency, waveform="square")
        points.append(compared(cycles, scene.gain, fitted_gain(scene, frame), found))
    return points


@limit(
    "half-row-rate",
    "A tone at half the row rate",
    sweep="bins below half the row rate",
    error="RMS error of the gain",
    plain="Fourier sum at the exact frequency",
    why="At half the row rate the rows see the tone at two points of its cycle: amplitude and phase are not separable, "
    "and the sum includes its own mirror image.",
    then="Fits both; the standard error grows. At half the row rate and its multiples: NaN, UNRESOLVABLE.",
    spot=0.1,
    fails_by=0.1,
    good=0.02,
    flags=Flag.UNRESOLVABLE | Flag.WEAK | Flag.ILL_CONDITIONED,
)
def _half_row_rate() -> list[Point]:
    points = []
    for bins in (1e-3, 1e-2, 0.03, 0.1, 0.3, 1.3):
        scene = dataclasses.replace(_BASE, cycles=_BASE.rows / 2 - bins, exposure_cycles=0.3)
        frame = _frame(scene)
        found = tone_gain(frame, scene.camera, scene.frequency)
        points.append(compared(bins, scene.gain, transform_gain(scene, frame), found))
    return points


@limit(
    "alias",
    "Row aliasing",
    sweep="f·T_r",
    error="RMS error of the depth",
    plain="frequency of the highest bin, its gain over |sinc| of that frequency",
    why="Rows sample at 1/T_r: above half of it the tone shows at another frequency, but the exposure has weakened it "
    "by |sinc| of the true one.",
    then="Fits the alias of the frequency it is given, with the response and the phase of the true one. ALIASED.",
    spot=0.85,
    fails_by=0.3,
    good=0.02,
    flags=Flag(0),
)
def _alias() -> list[Point]:
    points = []
    for per_row in (0.15, 0.3, 0.45, 0.55, 0.7, 0.85, 0.95):
        scene = dataclasses.replace(_BASE, cycles=per_row * _BASE.rows, exposure_cycles=0.8 * per_row)
        frame = _frame(scene)
        seen = float(np.median(peak_frequency(frame)))
        shown = dataclasses.replace(scene, cycles=seen * scene.rows)
        plain = transform_gain(shown, frame) / np.sinc(0.8 * seen) * scene.gain
        found = tone_gain(frame, scene.camera, scene.frequency)
        points.append(compared(per_row, scene.gain, plain, found, 1.0 / scene.gain))
    return points


@limit(
    "rounded-bin",
    "The rounded bin between bins",
    sweep="distance from the bin",
    error="RMS error of the gain",
    plain="the paper's: the bin nearest to N·T_r·f",
    why="Off its centre a bin holds |sinc| of the distance, 2/π half-way, and the leak of the mirror image.",
    then="Fits at the exact frequency. Method `dft` is the paper's and flags OFF_BIN.",
    spot=0.5,
    fails_by=0.15,
    good=0.005,
)
def _rounded_bin() -> list[Point]:
    points = []
    for distance in (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5):
        scene = dataclasses.replace(_BASE, cycles=8.0 + distance)
        frame = _frame(scene)
        found = tone_gain(frame, scene.camera, scene.frequency)
        points.append(compared(distance, scene.gain, rounded_bin_gain(scene, frame), found))
    return points


@limit(
    "two-sources",
    "Two sources close in frequency",
    sweep="distance in bins",
    error="RMS error of the gain",
    plain="fit of mean and one tone",
    why="Within a frame neighbours less than a bin apart are nearly alike; a fit of one of them includes the other.",
    then="Fits all frequencies it is given together: unbiased, with a standard error that grows as they approach.",
    spot=0.1,
    fails_by=0.1,
    good=0.01,
    flags=Flag.ILL_CONDITIONED | Flag.WEAK,
)
def _two_sources() -> list[Point]:
    points = []
    for bins in (0.03, 0.1, 0.3, 0.5, 1.0, 2.3, 5.4):
        scene, other, frame = _two(bins)
        both = tone_gain(frame, Camera(scene.row_time), [scene.frequency, other.frequency])
        first: Any = _OneOf(both.gain[0], both.gain_std[0], both.flags[0])
        points.append(compared(bins, 0.5 * scene.gain, fitted_gain(scene, frame), first))
    return points


def _two(bins: float) -> tuple[Scene, Scene, npt.NDArray[np.uint8]]:
    """A source, its neighbour, and the sum of their light; the gain of the first is then half its own."""
    scene = dataclasses.replace(_BASE, cycles=20.0, mean=60.0)
    other = dataclasses.replace(scene, cycles=20.0 + bins, depth=0.8)
    random = np.random.default_rng(int(1000 * bins))
    light = scene.light(random.random(200)) + other.light(random.random(200))
    return scene, other, np.rint(light + 2.0 * random.standard_normal(light.shape)).astype(np.uint8)


@limit(
    "unknown-neighbour",
    "A neighbour that is not known of",
    sweep="distance in bins",
    error="RMS error of the gain",
    plain="fit of mean and one tone, as in `tone_gain`",
    why="As before, with an unknown second source.",
    then="`varying_tone_gain` sees the slow beat of the two, MODEL_MISFIT, but cannot correct it. Nearer than a "
    "quarter of a bin one frame does not separate them; from two bins on the other source counts as noise, and the "
    "standard error is at first half of the error.",
    spot=0.5,
    fails_by=0.05,
    good=0.01,
    flags=Flag.MODEL_MISFIT,
    silent=(0.03, 0.1, 2.3),
)
def _unknown_neighbour() -> list[Point]:
    points = []
    for bins in (0.03, 0.1, 0.3, 0.5, 0.7, 1.0, 1.5, 2.3, 3.5, 5.4):
        scene, _, frame = _two(bins)
        found = varying_tone_gain(frame, scene.camera, scene.frequency)
        points.append(compared(bins, 0.5 * scene.gain, fitted_gain(scene, frame), found))
    return points


def _varying_point(x: float, scene: Scene, slope: float, drift: float) -> Point:
    """Light that decreases by ``slope`` of its mean along the rows, and a frequency that increases by ``drift`` cycles
    per frame over the frame, both symmetric about the middle row."""
    random = np.random.default_rng(13)
    u = (np.arange(scene.rows) - 0.5 * (scene.rows - 1)) / scene.rows
    turns = (scene.cycles * u + 0.5 * drift * u**2)[:, None] + random.random(scene.columns)
    light = scene.mean * (1.0 - slope * u[:, None]) * (1.0 + scene.gain * np.cos(2.0 * np.pi * turns))
    frame = np.clip(np.rint(light + scene.noise * random.standard_normal(light.shape)), 0, 255).astype(np.uint8)
    found = varying_tone_gain(frame, scene.camera, scene.frequency)
    return compared(x, scene.gain, fitted_gain(scene, frame), found)


@limit(
    "gradient",
    "A strong gradient",
    sweep="fall along the rows / mean",
    error="RMS error of the gain",
    plain="fit of mean and tone, as in `tone_gain`",
    why="A slope is not orthogonal to a few cycles and leaks into them, as 1/cycles. The standard error takes what is "
    "left of the slope for noise: too much at many cycles, too little at few.",
    then="`varying_tone_gain` fits light and tone that vary as polynomials; MODEL_MISFIT where the error of "
    "`tone_gain` exceeds its standard error. `tone_gain` alone does not detect it; `ocisac gain` flags it.",
    spot=1.2,
    fails_by=0.02,
    good=0.005,
    flags=Flag.MODEL_MISFIT,
)
def _gradient() -> list[Point]:
    scene = dataclasses.replace(_BASE, cycles=3.3)
    return [_varying_point(slope, scene, slope, 0.0) for slope in (0.0, 0.03, 0.1, 0.3, 0.6, 1.2)]


@limit(
    "drift",
    "Frequency drift within a frame",
    sweep="drift over the frame, cycles/frame",
    error="RMS error of the gain",
    plain="fit of mean and tone at the mean frequency, as in `tone_gain`",
    why="The tone runs out of step with the model, and the parts cancel; a frequency that is off by a part of a cycle "
    "in the frame does the same.",
    then="`varying_tone_gain` follows the phase: right to about 2 cycles/frame of drift, low beyond; MODEL_MISFIT "
    "marks a wrong `tone_gain`. `tone_gain` alone does not detect it; `ocisac gain` flags it.",
    spot=2.0,
    fails_by=0.04,
    good=0.005,
    flags=Flag.MODEL_MISFIT,
)
def _drift() -> list[Point]:
    scene = dataclasses.replace(_BASE, cycles=12.3)
    return [_varying_point(drift, scene, 0.0, drift) for drift in (0.0, 0.3, 0.6, 1.0, 2.0, 4.0)]


@dataclasses.dataclass(frozen=True)
class _OneOf:
    gain: Float64s
    gain_std: Float64s
    flags: npt.NDArray[np.uint32]
