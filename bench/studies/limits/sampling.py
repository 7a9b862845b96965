"""Limits of frequency and sampling: nulls, few cycles, aliases, bins, neighbours, drift, gradient."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.tones.frequency import find_frequency
from ocisac_fast.tones.gain import tone_gain
from ocisac_fast.tones.varying_tone import varying_tone_gain
from studies.chart.scenes import Scene
from studies.limits.catalogue import Point, compared, limit, rms, shared_flags
from studies.limits.plain_methods import fitted_gain, gain_of_frame, peak_frequency, rounded_bin_gain, transform_gain

_BASE = Scene("limits", "", 12.0, rows=720, columns=200)


@limit(
    "Sinc null: gain",
    "distance of f·T_e from 1",
    "RMS error of the depth",
    spot=1e-4,
    fails_by=5.0,
    good=0.05,
    flags=Flag.NEAR_NULL | Flag.WEAK,
)
def _null_gain() -> Iterator[Point]:
    for distance in (1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3):
        scene = dataclasses.replace(_BASE, exposure_cycles=1.0 + distance)
        yield gain_of_frame(distance, scene, transform_gain, 1.0 / scene.gain)


@limit(
    "Less than one cycle in the frame",
    "cycles in the frame",
    spot=0.4,
    fails_by=0.3,
    good=0.02,
    flags=Flag.FEW_CYCLES,
)
def _few_cycles() -> Iterator[Point]:
    for cycles in (0.1, 0.2, 0.4, 0.7, 1.2, 1.6, 2.4, 4.3):
        yield gain_of_frame(cycles, dataclasses.replace(_BASE, cycles=cycles), transform_gain)


@limit(
    "Frequency from few cycles",
    "cycles in the frame",
    "RMS error, cycles/frame",
    spot=1.5,
    fails_by=0.3,
    good=0.02,
    flags=Flag.FEW_CYCLES | Flag.NO_TONE,
)
def _few_cycles_frequency() -> Iterator[Point]:
    random = np.random.default_rng(15)
    for cycles in (0.6, 1.1, 1.5, 2.2, 3.4, 5.5, 11.3):
        scene = dataclasses.replace(_BASE, cycles=cycles, columns=4)
        lights = [np.tile(scene.light([phase]), 4) for phase in random.random(24)]
        frames = [light + scene.noise * random.standard_normal(light.shape) for light in lights]
        found = [find_frequency(frame, Camera(1.0), waveform="tone") for frame in frames]
        plain = np.array([np.median(peak_frequency(frame)) for frame in frames])
        flags = shared_flags(np.array([int(one.flags) for one in found], np.uint32))
        stated = scene.rows * rms([one.frequency_std for one in found])
        error = rms(scene.rows * np.array([one.frequency for one in found]) - cycles)
        yield Point(cycles, rms(scene.rows * plain - cycles), error, stated, flags)


@limit("Very short columns", "rows", spot=3, fails_by=0.05, good=0.02, flags=Flag.UNRESOLVABLE)
def _short() -> Iterator[Point]:
    for rows in (3, 4, 5, 7, 11, 23, 101):
        scene = Scene("limits", "", 0.23 * rows, rows=rows, columns=400, noise=8.0)
        yield gain_of_frame(rows, scene, fitted_gain)


@limit(
    "Harmonics of a square wave",
    "cycles in the frame",
    spot=1.7,
    fails_by=0.01,
    good=0.003,
    flags=Flag.HARMONICS_DROPPED,
)
def _harmonics() -> Iterator[Point]:
    for cycles in (1.2, 1.7, 2.3, 3.7, 6.3, 12.3):
        scene = dataclasses.replace(_BASE, cycles=cycles, exposure_cycles=0.1, depth=0.9, waveform="square")
        yield gain_of_frame(cycles, scene, fitted_gain, waveform="square")


@limit(
    "A tone at half the row rate",
    "bins below half the row rate",
    spot=0.1,
    fails_by=0.1,
    good=0.02,
    flags=Flag.UNRESOLVABLE | Flag.WEAK | Flag.ILL_CONDITIONED,
)
def _half_row_rate() -> Iterator[Point]:
    for bins in (1e-3, 1e-2, 0.03, 0.1, 0.3, 1.3):
        scene = dataclasses.replace(_BASE, cycles=_BASE.rows / 2 - bins, exposure_cycles=0.3)
        yield gain_of_frame(bins, scene, transform_gain)


@limit("Row aliasing", "f·T_r", "RMS error of the depth", spot=0.85, fails_by=0.3, good=0.02)
def _alias() -> Iterator[Point]:
    for per_row in (0.15, 0.3, 0.45, 0.55, 0.7, 0.85, 0.95):
        scene = dataclasses.replace(_BASE, cycles=per_row * _BASE.rows, exposure_cycles=0.8 * per_row)
        frame = next(scene.frames(1))
        seen = float(np.median(peak_frequency(frame)))
        shown = dataclasses.replace(scene, cycles=seen * scene.rows)
        plain = transform_gain(shown, frame) / np.sinc(0.8 * seen) * scene.gain
        found = tone_gain(frame, scene.camera, scene.frequency)
        yield compared(per_row, scene.gain, plain, found, 1.0 / scene.gain)


@limit("The rounded bin between bins", "distance from the bin", spot=0.5, fails_by=0.15, good=0.005)
def _rounded_bin() -> Iterator[Point]:
    for distance in (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5):
        yield gain_of_frame(distance, dataclasses.replace(_BASE, cycles=8.0 + distance), rounded_bin_gain)


@limit(
    "Two sources close in frequency",
    "distance in bins",
    spot=0.1,
    fails_by=0.1,
    good=0.01,
    flags=Flag.ILL_CONDITIONED | Flag.WEAK,
)
def _two_sources() -> Iterator[Point]:
    for bins in (0.03, 0.1, 0.3, 0.5, 1.0, 2.3, 5.4):
        scene, other, frame = _two(bins)
        both = tone_gain(frame, Camera(scene.row_time), [scene.frequency, other.frequency])
        first = SimpleNamespace(gain=both.gain[0], gain_std=both.gain_std[0], flags=both.flags[0])
        yield compared(bins, 0.5 * scene.gain, fitted_gain(scene, frame), first)


def _two(bins: float) -> tuple[Scene, Scene, npt.NDArray[np.uint8]]:
    """A source, its neighbour, and the sum of their light; the gain of the first is then half its own."""
    scene = dataclasses.replace(_BASE, cycles=20.0, mean=60.0)
    other = dataclasses.replace(scene, cycles=20.0 + bins, depth=0.8)
    random = np.random.default_rng(int(1000 * bins))
    light = scene.light(random.random(200)) + other.light(random.random(200))
    return scene, other, np.rint(light + 2.0 * random.standard_normal(light.shape)).astype(np.uint8)


@limit(
    "A neighbour that is not known of",
    "distance in bins",
    spot=0.5,
    fails_by=0.05,
    good=0.01,
    flags=Flag.MODEL_MISFIT,
    silent=(0.03, 0.1),
)
def _unknown_neighbour() -> Iterator[Point]:
    for bins in (0.03, 0.1, 0.3, 0.5, 0.7, 1.0, 1.5, 2.3, 3.5, 5.4):
        scene, _, frame = _two(bins)
        found = varying_tone_gain(frame, scene.camera, scene.frequency)
        yield compared(bins, 0.5 * scene.gain, fitted_gain(scene, frame), found)


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


@limit("A strong gradient", "fall along the rows / mean", spot=1.2, fails_by=0.02, good=0.005, flags=Flag.MODEL_MISFIT)
def _gradient() -> Iterator[Point]:
    scene = dataclasses.replace(_BASE, cycles=3.3)
    for slope in (0.0, 0.03, 0.1, 0.3, 0.6, 1.2):
        yield _varying_point(slope, scene, slope, 0.0)


@limit(
    "Frequency drift within a frame",
    "drift over the frame, cycles/frame",
    spot=2.0,
    fails_by=0.04,
    good=0.005,
    flags=Flag.MODEL_MISFIT,
)
def _drift() -> Iterator[Point]:
    scene = dataclasses.replace(_BASE, cycles=12.3)
    for drift in (0.0, 0.3, 0.6, 1.0, 2.0, 4.0):
        yield _varying_point(drift, scene, 0.0, drift)
