"""A light that sends data, told by the waveform that its columns have in common and by the clock of its edges, in plain
NumPy: windows are convolved directly."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
Box = tuple[int, int, int, int]  # column, row, width, height

ROUNDS, COHERENCE, POWER, LIKENESS, SWING, HYSTERESIS = 2, 0.6, 0.02, 0.5, 0.15, 0.5
MIN_EDGES, MAX_TIMED, EDGE_EVIDENCE, FREQUENCY_REACH = 6, 64, 0.5, 0.25
FASTEST_CHIP, SLOWEST_CHIP, LARGEST_CLOCK = 2.2, 0.7, 0.4  # chips in a short interval; a row
MAX_GROUPS, MAX_COLUMNS = 64, 32


class DataLight(NamedTuple):
    """A box with its waveform, and what tells for it."""

    box: Box
    waveform: Array
    snr: float
    amplitude: float
    texture: float
    edges: int
    evidence: float


def find_data_light(light: Array, floor: float, suspect: Box, frequency: float) -> DataLight | None:
    """Rows whose halves swing alike and columns that swing as the middle does, in turn; None without six edges."""
    length = 2 * math.floor(2 / frequency + 0.5) + 1
    rows, columns = light.shape
    box = (suspect[0], suspect[1], min(suspect[2], columns - suspect[0]), min(suspect[3], rows - suspect[1]))
    if box[2] < 2:
        return None
    left, right = _halves(light, floor, box, box[1], box[1] + box[3], length).T
    if left @ right <= COHERENCE * math.sqrt((left @ left) * (right @ right)):
        return None
    for _ in range(ROUNDS):
        lit = _lit_rows(light, floor, box, length) if box[2] > 1 else None
        lit = _lit_columns(light, floor, lit, length) if lit else None
        if lit is None:
            return None
        box = lit
    column, row, width, height = box
    patch = _groups(light[row : row + height, column : column + width], _group(width, width))
    if patch.shape[1] < 2:
        return None
    logs = np.log(np.maximum(patch, 0) + floor)
    fast = logs - _local_means(logs, length)
    weights = np.maximum(_local_means(fast * fast.mean(axis=1, keepdims=True), length), 0)
    squares = (weights**2).sum(axis=1)
    waveform = np.where(squares > 0, (weights * fast).sum(axis=1) / np.sqrt(np.where(squares > 0, squares, 1)), 0)
    energy, common = float((fast**2).sum()), float(waveform @ waveform)
    edges = _edges(waveform)
    if len(edges) < MIN_EDGES or energy <= 0:
        return None
    share = min(common / energy, 1.0)
    mixed = np.sort(np.abs(np.diff(np.diff(logs, axis=0), axis=1)), axis=None)
    noise = logs.size * (mixed[mixed.size // 2] / 0.6745) ** 2 / 4 if mixed.size else 0.0
    mean = patch.mean(axis=1, keepdims=True)
    return DataLight(
        box,
        waveform,
        share / max(1 - share, 1e-12),
        float(np.sqrt(np.mean((mean - _local_means(mean, length)) ** 2))),
        max(energy * (1 - share) - noise, 0.0) / max(common, 1e-300),
        len(edges),
        EDGE_EVIDENCE * len(edges) + _clock_evidence(edges),
    )


def _local_means(x: Array, length: int) -> Array:
    """Means down the rows under a Hann window; rows before and after repeat the first and the last."""
    offsets = np.arange(length) - length // 2
    window = (1 + np.cos(2 * np.pi * offsets / length)) / length
    padded = np.pad(x, ((length // 2, length // 2), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, window, "valid") for column in padded.T], axis=1)


def _group(all_columns: int, width: int) -> int:
    return min(max(-(-all_columns // MAX_GROUPS), min(max(width // 16, 1), 8)), all_columns)


def _groups(light: Array, group: int) -> Array:
    count = light.shape[1] // group
    return np.asarray(light[:, : count * group].reshape(light.shape[0], count, group).mean(axis=2))


def _mean_light(light: Array, left: int, right: int, top: int, bottom: int) -> Array:
    return np.asarray(light[top:bottom, left : right : -(-(right - left) // MAX_COLUMNS)].mean(axis=1))


def _halves(light: Array, floor: float, box: Box, top: int, bottom: int, length: int) -> Array:
    """Log light of the left and the right half of the columns, less its local mean: (rows, 2)."""
    left, middle, right = box[0], box[0] + box[2] // 2, box[0] + box[2]
    halves = [_mean_light(light, *span, top, bottom) for span in ((left, middle), (middle, right))]
    logs = np.log(np.maximum(np.stack(halves, axis=1), 0) + floor)
    return np.asarray(logs - _local_means(logs, length))


def _run(places: Array, first: int, end: int) -> tuple[int, int] | None:
    """The run of true places about the middle one of those in [first, end)."""
    inside = first + np.nonzero(places[first:end])[0]
    if not inside.size:
        return None
    false = np.nonzero(~places)[0]
    middle = int(inside[inside.size // 2])
    before, after = false[false < middle], false[false > middle]
    return (int(before[-1]) + 1 if before.size else 0), (int(after[0]) if after.size else places.size)


def _lit_rows(light: Array, floor: float, box: Box, length: int) -> Box | None:
    reach = max(8 * length, 2 * box[3])
    top, bottom = max(box[1] - reach, 0), min(box[1] + box[3] + reach, light.shape[0])
    a, b = _halves(light, floor, box, top, bottom, length).T
    ab, aa, bb = _local_means(np.stack([a * b, a * a, b * b], axis=1), length).T
    first, end = box[1] - top, box[1] - top + box[3]
    high = np.sort(ab[first:end])[box[3] * 9 // 10]
    run = _run(ab > np.maximum(COHERENCE * np.sqrt(np.maximum(aa * bb, 0)), POWER * high), first, end)
    return None if run is None else (box[0], top + run[0], box[2], run[1] - run[0])


def _lit_columns(light: Array, floor: float, box: Box, length: int) -> Box | None:
    column, row, width, height = box
    reach = max(width, height)
    left, right = max(column - reach, 0), min(column + width + reach, light.shape[1])
    group = _group(right - left, width)
    logs = np.log(np.maximum(_groups(light[row : row + height, left:right], group), 0) + floor)
    x = logs - _local_means(logs, length)
    own = np.log(np.maximum(_mean_light(light, column, column + width, row, row + height), 0) + floor)[:, None]
    s = (own - _local_means(own, length))[:, 0]
    products, energy = s @ x, s @ s
    lit = products > np.maximum(LIKENESS * np.sqrt((x**2).sum(axis=0) * energy), SWING * energy)
    first = min((column - left) // group, lit.size - 1)
    run = _run(lit, first, min(max((column + width - left) // group, first + 1), lit.size))
    return None if run is None else (left + run[0] * group, row, (run[1] - run[0]) * group, height)


def _edges(waveform: Array) -> list[int]:
    """Rows in which the waveform has crossed to the other side of its mean."""
    least = HYSTERESIS * math.sqrt(float(np.mean(waveform**2)))
    far = np.nonzero(np.abs(waveform) > least)[0]
    sides = np.sign(waveform[far])
    return [int(n) for n in far[1:][sides[1:] != sides[:-1]]]


def _clock_evidence(edges: list[int]) -> float:
    """Rayleigh's statistic of the best clock of the edges, less the ln of the number of clocks tried."""
    at = np.array(edges[:MAX_TIMED], float)
    interval = max(float(np.sort(np.diff(at))[1]), 2.0)
    slowest, fastest = SLOWEST_CHIP / interval, min(FASTEST_CHIP / interval, LARGEST_CLOCK)
    span = at[-1] - at[0]
    clocks = slowest + 0.25 * np.arange(max(math.ceil((fastest - slowest) * 4 * span), 0)) / span
    best = float((np.abs(np.exp(-2j * np.pi * np.outer(clocks, at)).sum(axis=1)) ** 2).max(initial=0)) / at.size
    return max(best - math.log(max((fastest - slowest) * span, 1.0)), 0.0)
