"""Parts of one light told from neighbours: what lies between parts of one light swings as they do. Plain NumPy."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
Box = tuple[int, int, int, int]  # column, row, width, height

MAX_COLUMNS = 32
MIN_BESIDE, MIN_ABOVE = 0.8, 0.9  # correlation of swings
MIN_BETWEEN, MIN_ROWS_BETWEEN = 0.4, 0.7  # swing between parts, of the fainter part's
TOUCHING = 8  # columns apart
MIN_ALIKE, MIN_STRIP, MAX_STRIPS = 0.5, 8, 24  # of lamps that touch


Part = tuple[Box, float]  # with its cycles per row


def one_light_across(light: Array, floor: float, a: Part, b: Part) -> bool:
    """Whether parts beside each other are of one light."""
    return _beside(light, floor, *sorted((a, b), key=lambda part: part[0][0]))


def one_light_down(light: Array, floor: float, a: Part, b: Part) -> bool:
    """Whether parts above each other are of one light, which then sends data."""
    return _above(light, floor, *sorted((a, b), key=lambda part: part[0][1]))


def runs_beside(light: Array, floor: float, box: Box, frequency: float) -> list[tuple[int, int, Array]]:
    """First column, end and swing of runs of columns that swing unlike the run before, a fifth of the box or more each;
    none where the outer quarters swing alike."""
    column, row, width, height = box

    def swing(left: int, right: int) -> Array:
        return _swing(light, floor, left, right, row, row + height, _length(frequency, frequency))

    quarter = width // 4
    if width < 2 * MIN_STRIP:
        return []
    outer = swing(column, column + quarter), swing(column + width - quarter, column + width)
    if _likeness(*outer) >= MIN_ALIKE:
        return []
    strips = min(width // MIN_STRIP, MAX_STRIPS)
    edges = [column + k * width // strips for k in range(strips + 1)]
    runs = [(edges[0], edges[1], swing(edges[0], edges[1]))]
    for left, right in itertools.pairwise(edges[1:]):
        first, _, run = runs[-1]
        wave = swing(left, right)
        if _likeness(run, wave) >= MIN_ALIKE:
            runs[-1] = first, right, run + wave
        else:
            runs.append((left, right, wave))
    wide = [run for run in runs if 5 * (run[1] - run[0]) >= width]
    return wide if len(wide) > 1 else []


def _beside(light: Array, floor: float, before: Part, behind: Part) -> bool:
    """The same swing in the rows of both, and in the columns between."""
    (one, f), (other, g) = before, behind
    top, bottom = max(one[1], other[1]), min(one[1] + one[3], other[1] + other[3])
    left, right = one[0] + one[2], other[0]
    if 2 * (bottom - top) < min(one[3], other[3]) or bottom <= top:
        return False
    if right - left > max(one[2], other[2]) or 2 * (left - right) > min(one[2], other[2]):
        return False
    length = _length(f, g)
    first, second = (_swing(light, floor, box[0], box[0] + box[2], top, bottom, length) for box in (one, other))
    if _likeness(first, second) < MIN_BESIDE:
        return False
    if right - left < TOUCHING:
        return True
    between = _swing(light, floor, left, right, top, bottom, length)
    least = MIN_BETWEEN * min(_size(first), _size(second))
    return _likeness(first, between) >= MIN_BESIDE and _size(between) >= least


def _above(light: Array, floor: float, upper: Part, lower: Part) -> bool:
    """Much the same columns, and in the rows between, a cycle or more, they swing alike and as far as the parts do."""
    (one, f), (other, g) = upper, lower
    left, right = max(one[0], other[0]), min(one[0] + one[2], other[0] + other[2])
    first, last = one[1] + one[3], other[1]
    if 10 * (right - left) < 8 * max(one[2], other[2]) or right - left < 4:
        return False
    if (last - first) * max(f, g) < 1 or last - first > one[3] + other[3]:
        return False
    middle, length = (left + right) // 2, _length(f, g)
    halves = [
        _swing(light, floor, *span, one[1], last + other[3], length) for span in ((left, middle), (middle, right))
    ]
    gap = slice(first - one[1], last - one[1])
    both = halves[0] + halves[1]
    least = MIN_ROWS_BETWEEN * min(_size(both[: gap.start]), _size(both[gap.stop :]))
    return _likeness(halves[0][gap], halves[1][gap]) >= MIN_ABOVE and _size(both[gap]) >= least


def _length(f: float, g: float) -> int:
    """Rows of the mean that is taken off: two of the slower one's cycles, an odd number."""
    return 2 * math.floor(1 / min(f, g) + 0.5) + 1


def _swing(light: Array, floor: float, left: int, right: int, top: int, bottom: int, length: int) -> Array:
    """Logarithm of the light of some rows, mean over at most 32 columns evenly spaced, less its running mean."""
    step = -(-(right - left) // MAX_COLUMNS)
    rows = np.log(np.maximum(light[top:bottom, left:right:step].mean(axis=1), 0.0) + floor)
    padded = np.pad(rows, length // 2, "edge")
    return np.asarray(rows - np.convolve(padded, np.ones(length) / length, "valid"))


def _size(swing: Array) -> float:
    return float(np.sqrt(np.mean(swing**2))) if swing.size else 0.0


def _likeness(a: Array, b: Array) -> float:
    """Correlation about zero."""
    energy = float(a @ a) * float(b @ b)
    return float(a @ b) / energy**0.5 if energy > 0 else 0.0
