"""Shares of low total variation about slow slopes, in plain NumPy: one step of iteratively reweighted least squares.

Couplings are kept for each axis as arrays of the differences along it, trends as full pictures, and the equations are
solved level by level through recursion, where the core keeps padded rows and blocks; results agree to rounding.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Pair = tuple[FloatArray, FloatArray]  # along the columns, along the rows

VARIATION, MIN_SLOPE, BLOCK, REACH = 40.0, 1e-3, 8, 40.0
ITERATIONS = (4, 12, 20, 40)


def smoothing_step(
    pull: FloatArray, weight: FloatArray, share: FloatArray, trend: tuple[FloatArray, ...]
) -> tuple[FloatArray, Pair]:
    """The change of (rows, columns) shares, and the trend of their slopes for the next step."""
    slopes = np.diff(share, axis=0), np.diff(share, axis=1)
    steep = np.zeros(share.shape)
    for axis in (0, 1):
        square = (slopes[axis] - _without_last(trend[axis], axis)) ** 2 / 2
        steep += _before(square, axis) + _after(square, axis)
    coupling = tuple(
        VARIATION / np.sqrt(MIN_SLOPE**2 + (_without_last(steep, axis) + _without_first(steep, axis)) / 2)
        for axis in (0, 1)
    )
    down, across = (_trend(slopes[axis], coupling[axis], share.shape, axis) for axis in (0, 1))
    right = pull.copy()
    for axis, slow in enumerate((down, across)):
        flow = coupling[axis] * (slopes[axis] - _without_last(slow, axis))
        right += _before(flow, axis) - _after(flow, axis)
    return _solve(weight + 1e-3, right, (coupling[0], coupling[1]), 0), (down, across)


def _solve(weight: FloatArray, right: FloatArray, coupling: Pair, level: int) -> FloatArray:
    """Conjugate gradients from the answer for sums of 2 x 2 pixels."""
    rows, columns = weight.shape
    start = np.zeros(weight.shape)
    coarsest = level == len(ITERATIONS) - 1 or min(rows, columns) < 8
    if not coarsest:
        fewer = _halved(coupling[0][1::2], 1), _halved(coupling[1][:, 1::2], 0)
        coarse = _solve(_halved(_halved(weight, 0), 1), _halved(_halved(right, 0), 1), fewer, level + 1)
        start = coarse.repeat(2, axis=0).repeat(2, axis=1)[:rows, :columns]
    return _conjugate_gradients(weight, right, coupling, start, ITERATIONS[-1 if coarsest else level])


def _conjugate_gradients(
    weight: FloatArray, right: FloatArray, coupling: Pair, start: FloatArray, count: int
) -> FloatArray:
    def apply(x: FloatArray) -> FloatArray:
        flows = [coupling[axis] * np.diff(x, axis=axis) for axis in (0, 1)]
        return weight * x + sum(_after(flow, axis) - _before(flow, axis) for axis, flow in enumerate(flows))

    diagonal = weight + sum(_after(one, axis) + _before(one, axis) for axis, one in enumerate(coupling))
    change, residual = start, right - apply(start)
    direction, size, before = np.zeros(weight.shape), float(np.sum(residual**2 / diagonal)), np.inf
    negligible = 1e-24 * size
    for _ in range(count):
        if size <= negligible:
            break
        direction = residual / diagonal + size / before * direction
        product = apply(direction)
        step = size / float(np.sum(direction * product))
        change = change + step * direction
        residual = residual - step * product
        before, size = size, float(np.sum(residual**2 / diagonal))
    return change


def _trend(slope: FloatArray, coupling: FloatArray, shape: tuple[int, ...], axis: int) -> FloatArray:
    """Mean of the slopes around by their couplings, for each block of 8 x 8 pixels."""
    sums, counts = (_around(_before(values, axis)) for values in (coupling * slope, coupling))
    slow = np.where(counts > 0, sums / np.where(counts > 0, counts, 1.0), 0.0)
    return np.asarray(slow.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)[: shape[0], : shape[1]])


def _around(values: FloatArray) -> FloatArray:
    """Sums of blocks, those around counting less by exp(-distance/reach), twice each way."""
    starts = [np.arange(0, length, BLOCK) for length in values.shape]
    blocks = np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)
    down, across = (
        np.exp(-np.abs(np.subtract.outer(np.arange(n), np.arange(n))) * BLOCK / REACH) for n in blocks.shape
    )
    return np.asarray(down @ (down @ blocks @ across) @ across)


def _halved(values: FloatArray, axis: int) -> FloatArray:
    """Sums of two each."""
    if values.size == 0:
        return np.zeros(tuple((n + 1) // 2 if k == axis else n for k, n in enumerate(values.shape)))
    return np.asarray(np.add.reduceat(values, np.arange(0, values.shape[axis], 2), axis=axis))


def _before(values: FloatArray, axis: int) -> FloatArray:
    """Differences at the pixel they start from."""
    return np.pad(values, [(0, 1 if k == axis else 0) for k in (0, 1)])


def _after(values: FloatArray, axis: int) -> FloatArray:
    """Differences at the pixel they go to."""
    return np.pad(values, [(1 if k == axis else 0, 0) for k in (0, 1)])


def _without_last(values: FloatArray, axis: int) -> FloatArray:
    return np.take(values, range(values.shape[axis] - 1), axis=axis)


def _without_first(values: FloatArray, axis: int) -> FloatArray:
    return np.take(values, range(1, values.shape[axis]), axis=axis)
