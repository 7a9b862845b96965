"""Limits of arithmetic: recurrences, sums and lengths."""

from __future__ import annotations

import dataclasses

import numpy as np

from ocisac_fast.core.flags import Flag
from ocisac_fast.tones.gain import tone_gain
from studies.chart.scenes import Scene
from studies.limits.catalogue import Point, compared, limit
from studies.limits.plain_methods import (
    fitted_gain,
    float32_sums_gain,
    goertzel_float32_gain,
    padded_bin_gain,
)

_EXACT = Scene("limits", "", 3.0, exposure_cycles=0.6, noise=0.0, columns=8)


def _float32(scene: Scene) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return scene.light(np.arange(scene.columns) / scene.columns).astype(np.float32)


@limit(
    "goertzel",
    "Goertzel in float32",
    sweep="rows of 1 cycle",
    error="RMS error of the gain",
    plain="Goertzel's recurrence in float32",
    why="At low frequency its two poles all but meet: what 2·cos(2πf·T_r) differs from 2 by drowns in its rounding, "
    "and the state's rounding adds up with the square of the rows.",
    then="Takes phases from the row's number and sums in float64 (or exact integers of bytes).",
    spot=10000,
    fails_by=0.05,
    good=1e-6,
)
def _goertzel() -> list[Point]:
    points = []
    for rows in (100, 300, 1000, 3000, 10000, 30000):
        scene = dataclasses.replace(_EXACT, rows=rows, cycles=1.0)
        light = _float32(scene)
        found = tone_gain(light, scene.camera, scene.frequency)
        points.append(compared(rows, scene.gain, goertzel_float32_gain(scene, light), found))
    return points


@limit(
    "float32-sums",
    "Sums in float32",
    sweep="rows, 3 cycles, depth 1 %",
    error="RMS error / gain",
    plain="Fourier sum and mean, added down the rows in float32",
    why="A sum of float32 drops what lies 2^24 times below it: 16-bit samples reach that within 600 rows, and the "
    "dropped parts add up.",
    then="Adds integers exactly and everything else in float64.",
    spot=1_000_000,
    fails_by=3e-3,
    good=1e-5,
)
def _float32_sums() -> list[Point]:
    points = []
    for rows in (1000, 10_000, 100_000, 1_000_000):
        scene = dataclasses.replace(_EXACT, rows=rows, columns=2, mean=30_000.0, depth=0.01)
        light = _float32(scene)
        found = tone_gain(light, scene.camera, scene.frequency)
        points.append(compared(rows, scene.gain, float32_sums_gain(scene, light), found, 1.0 / scene.gain))
    return points


@limit(
    "short",
    "Very short columns",
    sweep="rows",
    error="RMS error of the gain",
    plain="fit of mean and tone by the normal equations",
    why="Three unknowns fit three rows without a residual, whatever the noise; a few more rows add little.",
    then="Up to three rows: NaN, UNRESOLVABLE. From four on an answer with its standard error.",
    spot=3,
    fails_by=0.05,
    good=0.02,
    flags=Flag.UNRESOLVABLE,
)
def _short() -> list[Point]:
    points = []
    for rows in (3, 4, 5, 7, 11, 23, 101):
        scene = Scene("limits", "", 0.23 * rows, rows=rows, columns=400, noise=8.0)
        frame = next(scene.frames(1))
        found = tone_gain(frame, scene.camera, scene.frequency)
        points.append(compared(rows, scene.gain, fitted_gain(scene, frame), found))
    return points


def _fast_length(rows: int) -> int:
    """The next product of powers of 2, 3 and 5."""
    length = rows
    while True:
        rest = length
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return length
        length += 1


@limit(
    "long-primes",
    "Lengths that are prime",
    sweep="rows (prime), 7 cycles",
    error="RMS error of the gain",
    plain="DFT with zeros up to a fast length, the nearest bin",
    why="DFTs of prime length are slow, so libraries advise padding; that moves the bins away from the tone.",
    then="Row weights have no favourite length; nothing is padded.",
    spot=1061,
    fails_by=0.003,
    good=1e-9,
)
def _long_primes() -> list[Point]:
    points = []
    for rows in (31, 97, 1061, 10_007, 100_003):
        scene = dataclasses.replace(_EXACT, rows=rows, cycles=7.0)
        light = scene.light(np.arange(8) / 8)
        found = tone_gain(light, scene.camera, scene.frequency)
        points.append(compared(rows, scene.gain, padded_bin_gain(scene, light, _fast_length(rows)), found))
    return points
