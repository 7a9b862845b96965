"""The comparison of a picture with a later one beside its lights, in plain NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Overview = npt.NDArray[np.float32]

STEP, SUMMED, TILE, WIDE, SKIPPED = 4, 8, 32, 8, 4  # columns, samples, rows, groups, rows
CLEAR, STEPS, BESIDE = 8.0, 1.5, 0.25  # energy over that of the noise, DN^2 of integers, size of a light


def overview(pixels: npt.NDArray[Any]) -> Overview:
    """(rows, groups) mean of every fourth column, in groups of eight."""
    sampled = pixels[:, ::STEP].astype(np.float32)
    summed = min(SUMMED, sampled.shape[1])
    groups = sampled.shape[1] // summed
    return np.asarray(sampled[:, : summed * groups].reshape(-1, groups, summed).mean(axis=2))


def has_changed(then: Overview, now: Overview, lights: Sequence[tuple[int, int, int, int]], integers: bool) -> bool:
    """True if the picture outside of the lights' boxes changed by more than noise, in a tile or in eight beside."""
    change = now - then
    least = CLEAR * noise(change) + STEPS * integers
    rows, groups = change.shape
    for left, top, width, height in lights:
        x, y = round(BESIDE * width) + TILE, round(BESIDE * height) + TILE
        first, last = max(left - x, 0) // (STEP * SUMMED), (left + width + x) // (STEP * SUMMED) + 1
        change[max(top - y, 0) : top + height + y, first:last] = 0.0
    tiles = change[: rows // TILE * TILE].reshape(-1, TILE, groups)
    wide = np.add.reduceat(tiles, np.arange(0, groups, WIDE), axis=2) / WIDE
    return any(bool((np.square(one).mean(axis=1) > most).any()) for one, most in ((tiles, least), (wide, least / WIDE)))


def noise(change: Overview) -> float:
    """Variance, from the median of mixed differences, which is robust against edges and stripes."""
    mixed, terms = change[1::SKIPPED] - change[:-1:SKIPPED], 2.0
    if mixed.shape[1] > 1:
        mixed, terms = mixed[:, 1:] - mixed[:, :-1], 4.0
    return float(np.median(np.abs(mixed)) / 0.6745) ** 2 / terms if mixed.size else 0.0
