"""Limits of arithmetic: recurrences, sums and lengths."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

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


@limit("Goertzel in float32", "rows of 1 cycle", "RMS error of the gain", spot=10000, fails_by=0.05, good=1e-6)
def _goertzel() -> Iterator[Point]:
    for rows in (100, 300, 1000, 3000, 10000, 30000):
        scene = dataclasses.replace(_EXACT, rows=rows, cycles=1.0)
        light = _float32(scene)
        found = tone_gain(light, scene.camera, scene.frequency)
        yield compared(rows, scene.gain, goertzel_float32_gain(scene, light), found)


@limit("Sums in float32", "rows, 3 cycles, depth 1 %", "RMS error / gain", spot=1_000_000, fails_by=3e-3, good=1e-5)
def _float32_sums() -> Iterator[Point]:
    for rows in (1000, 10_000, 100_000, 1_000_000):
        scene = dataclasses.replace(_EXACT, rows=rows, columns=2, mean=30_000.0, depth=0.01)
        light = _float32(scene)
        found = tone_gain(light, scene.camera, scene.frequency)
        yield compared(rows, scene.gain, float32_sums_gain(scene, light), found, 1.0 / scene.gain)


@limit("Very short columns", "rows", "RMS error of the gain", spot=3, fails_by=0.05, good=0.02, flags=Flag.UNRESOLVABLE)
def _short() -> Iterator[Point]:
    for rows in (3, 4, 5, 7, 11, 23, 101):
        scene = Scene("limits", "", 0.23 * rows, rows=rows, columns=400, noise=8.0)
        frame = next(scene.frames(1))
        found = tone_gain(frame, scene.camera, scene.frequency)
        yield compared(rows, scene.gain, fitted_gain(scene, frame), found)


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
    "Lengths that are prime", "rows (prime), 7 cycles", "RMS error of the gain", spot=1061, fails_by=0.003, good=1e-9
)
def _long_primes() -> Iterator[Point]:
    for rows in (31, 97, 1061, 10_007, 100_003):
        scene = dataclasses.replace(_EXACT, rows=rows, cycles=7.0)
        light = scene.light(np.arange(8) / 8)
        found = tone_gain(light, scene.camera, scene.frequency)
        yield compared(rows, scene.gain, padded_bin_gain(scene, light, _fast_length(rows)), found)
