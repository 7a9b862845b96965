"""The share of a modulated light in every pixel, and the light of every row, in plain NumPy.

Pairs of pixels are compared by array slices, and the row light is the solution of one dense system; the core uses
running sums and a band matrix. Results agree to rounding.

The smoothing of shares stores couplings for each axis as arrays of differences and trends as full pictures, and solves
the equations level by level by recursion; the core uses padded rows and blocks.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.reference.camera import linear_light

FloatArray = npt.NDArray[np.float64]
Parts = tuple[FloatArray, ...]
Pair = tuple[FloatArray, FloatArray]  # along the columns, along the rows


MIN_LIGHT = 0.05
ROW_TEXTURES = (0.5, 0.3, 0.2, 0.1, 0.05)
PLAN = [(0.5, 48)] * 3 + [(0.3, 32)] * 2 + [(0.2, 32)] + [(0.1, 24)] * 2
PLAN += [(0.05, 16)] * 2 + [(0.05, 12)] + [(0.05, 8)] * 2
WIDE, MERGED = 6, 4  # steps of the plan on added columns, and number of columns added, for smooth shares


def comparison_lag(row_light: FloatArray) -> int:
    """Lag in rows at which the mean squared change of (frames, rows) first reaches 0.7 of the variance."""
    most = min(max(row_light.shape[1] // 4, 1), 64)
    for lag in range(1, most):
        if np.mean((row_light[:, lag:] - row_light[:, :-lag]) ** 2) >= 0.7 * np.var(row_light):
            return int(lag)
    return int(most)


def _compare(one: Parts, two: Parts, texture: float) -> tuple[FloatArray, FloatArray]:
    """Gradient and curvature in q of log(texture^2 mean^2 + difference^2 + noise) of pairs (c, g, var)."""
    difference, mean, slope = two[0] - one[0], (two[0] + one[0]) / 2, two[1] - one[1]
    weight = (mean > 0) / (texture**2 * mean**2 + difference**2 + one[2] + two[2])
    return weight * mean * slope * difference, weight * (mean * slope) ** 2


def _passage(light: FloatArray, variance: FloatArray, reach: float, edge: float, axis: int) -> FloatArray:
    a, b = (np.moveaxis(light, axis, 0)[k] for k in (slice(None, -1), slice(1, None)))
    va, vb = (np.moveaxis(variance, axis, 0)[k] for k in (slice(None, -1), slice(1, None)))
    ratio = (b - a) ** 2 / ((edge * (a + b) / 2) ** 2 + 9 * (va + vb))
    return np.asarray(np.moveaxis(np.exp(-1 / reach) / (1 + ratio), 0, axis))


def _spread(values: FloatArray, passage: FloatArray, axis: int) -> FloatArray:
    """Sum over the line of each value times the product of the passages in between."""
    lines, through = np.moveaxis(values, axis, 0), np.moveaxis(passage, axis, 0)
    total = lines.copy()
    for direction in (1, -1):
        running = np.zeros_like(lines[0])
        gaps = through[::direction]
        order = range(len(lines))[::direction]
        for step, n in enumerate(order):
            if step:
                running = gaps[step - 1] * (running + lines[order[step - 1]])
                total[n] += running
    return np.moveaxis(total, 0, axis)


class _Picture:
    """Frames of linear light under a row light, with `merged` columns of the camera per column."""

    def __init__(self, light: FloatArray, variance: FloatArray, row_light: FloatArray, merged: int = 1) -> None:
        self.light, self.variance, self.change, self.merged = light, variance, row_light - 1, merged
        self.lag = comparison_lag(row_light)
        self.edge = 0.15 if len(light) > 1 else float(np.clip(0.025 * self.lag, 0.03, 0.25))
        self.most = 1 / max(-float(self.change.min()), 1e-9)

    def gather(self, q: FloatArray, texture: float) -> tuple[FloatArray, ...]:
        pull, weight, certain, sums = (np.zeros(q.shape) for _ in range(4))
        before: tuple[FloatArray, ...] | None = None
        for v, var, p in zip(self.light, self.variance, self.change[..., None], strict=True):
            left = np.maximum(1 + q * p, MIN_LIGHT)
            now = (v / left, p / left, var / left**2)
            upper, lower = tuple(part[: -self.lag] for part in now), tuple(part[self.lag :] for part in now)
            for into, values in zip((pull, weight), _compare(upper, lower, texture), strict=True):
                into[: -self.lag] += values / 2
                into[self.lag :] += values / 2
            if before is not None:
                for into, values in zip((pull, weight), _compare(before, now, 0.2 * texture), strict=True):
                    into += values
            before = now
            certain += 1 / now[2]
            sums += now[0] / now[2]
        return pull, weight, sums, certain

    def of_all(self) -> FloatArray:
        """Estimate one share for all pixels."""
        q = np.full(self.light.shape[1:], min(0.5 * self.most, 1.0))
        for _ in range(4):
            pull, weight, *_ = self.gather(q, PLAN[0][0])
            if weight.sum() > 0:
                q[:] = np.clip(q + pull.sum() / weight.sum(), 0, self.most)
        return q

    def step(self, q: FloatArray, texture: float, reach: float) -> FloatArray:
        pull, weight, sums, certain = self.gather(q, texture)
        down = _passage(*_means(sums, certain), 4 * self.lag, self.edge, 0)
        of_rows = max(reach, 2 * self.lag)
        of_columns = (of_rows if len(self.light) == 1 else reach) / self.merged
        along = _means(_spread(sums, down, 0), _spread(certain, down, 0))
        across = _passage(*along, of_columns, self.edge, 1)
        down = _passage(*_means(sums, certain), of_rows, self.edge, 0)
        pull, weight = (_spread_twice(values, down, across) for values in (pull + weight * q, weight))
        return np.clip((pull + 1000 * q) / (weight + 1000), 0, self.most)

    def step_at_lamp_edges(self, q: FloatArray) -> FloatArray:
        _, weight, sums, certain = self.gather(q, 0.05)
        c, var = _means(sums, certain)
        steady = c * np.maximum(1 - q / self.most, 0)
        reaches = (0, max(12, 2 * self.lag)), (1, 12)
        down, across = (_passage(steady, var, reach, 0.15, axis) for axis, reach in reaches)
        around = _spread_twice((weight + 1) * steady, down, across) / _spread_twice(weight + 1, down, across)
        other = np.where(c > 0, self.most * (1 - around / np.where(c > 0, c, 1.0)), q)
        other = np.minimum(np.maximum(other, _extreme(q, np.min)), _extreme(q, np.max))
        gain = _gain(self.light[0], self.variance[0], self.change[0, :, None], self.lag, q, other)
        down, across = np.full_like(down, np.exp(-1 / max(3, self.lag))), np.full_like(across, np.exp(-1 / 3))
        return np.where(_spread_twice(gain, down, across) > 3, other, q)


def light_share(light: FloatArray, variance: FloatArray, row_light: FloatArray, smooth: bool = True) -> FloatArray:
    """Estimate shares (rows, columns) of the light from (frames, rows, columns) and (frames, rows) of mean 1."""
    picture = _Picture(light, variance, row_light)
    merged = _Picture(*_merged(light, variance), row_light, MERGED) if smooth else picture
    q = merged.of_all()
    for texture, reach in PLAN[:WIDE]:
        q = merged.step(q, texture, reach)
    if smooth:
        q = q.repeat(MERGED, axis=1)[:, : light.shape[2]]
    for texture, reach in PLAN[WIDE:]:
        q = picture.step(q, texture, reach)
    if len(light) == 1:
        for _ in range(2 if smooth else 3):
            q = picture.step_at_lamp_edges(q)
    trend: Parts = (np.zeros(q.shape), np.zeros(q.shape))
    for _ in range(6 if smooth else 0):
        pull, weight, *_ = picture.gather(q, 0.05)
        change, trend = smoothing_step(pull, weight, q, trend)
        q = np.clip(q + change, 0, picture.most)
    return q


def _merged(light: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Means of neighbouring columns over pixels of finite variance."""
    known, starts = np.isfinite(variance), np.arange(0, light.shape[2], MERGED)
    count = np.add.reduceat(known.astype(float), starts, axis=2)
    sums, noise = (np.add.reduceat(np.where(known, values, 0.0), starts, axis=2) for values in (light, variance))
    divisor = np.maximum(count, 1)
    return sums / divisor, np.where(count > 0, noise / divisor**2, np.inf)


def _means(sums: FloatArray, certain: FloatArray) -> tuple[FloatArray, FloatArray]:
    known = certain > 0
    divisor = np.where(known, certain, 1.0)
    return np.where(known, sums / divisor, 0.0), np.where(known, 1 / divisor, np.inf)


def _spread_twice(values: FloatArray, down: FloatArray, across: FloatArray) -> FloatArray:
    for passage, axis in ((down, 0), (across, 1), (across, 1), (down, 0)):
        values = _spread(values, passage, axis)
    return values


def _extreme(values: FloatArray, of: Callable[..., FloatArray]) -> FloatArray:
    """Extremum within 12 pixels in each direction."""
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, 12, "edge"), (25, 25))
    return of(windows, axis=(2, 3))


def _gain(
    light: FloatArray, variance: FloatArray, change: FloatArray, lag: int, share: FloatArray, other: FloatArray
) -> FloatArray:
    """Log likelihood of pairs of rows with the other shares minus that with these, half of it at each pixel."""

    def misfit(q: FloatArray) -> FloatArray:
        left = np.maximum(1 + q * change, MIN_LIGHT)
        c, var = light / left, variance / left**2
        mean, difference, noise = (c[:-lag] + c[lag:]) / 2, c[lag:] - c[:-lag], var[:-lag] + var[lag:]
        return np.where(mean > 0, 0.05**2 + (difference**2 + noise) / np.where(mean > 0, mean, 1.0) ** 2, np.inf)

    with_other, without = misfit(other), misfit(share)
    known = np.isfinite(with_other) & np.isfinite(without)
    half = 0.25 * np.log(np.where(known, without, 1.0) / np.where(known, with_other, 1.0))
    gain = np.zeros_like(share)
    gain[:-lag] += half
    gain[lag:] += half
    return gain


def refine_row_light(
    light: FloatArray,
    variance: FloatArray,
    share: FloatArray,
    row_light: FloatArray,
    steps: int,
    basis: FloatArray | None = None,
    deviation: float = np.inf,
) -> tuple[FloatArray, FloatArray]:
    """Gauss-Newton steps of the row light of one frame (1, rows, columns): the light, and each row's information.

    ``basis`` (rows, terms) restricts the light to its span; ``deviation`` penalises deviation from the initial light.
    """
    rows = light.shape[1]
    result, information = row_light.copy(), np.zeros(rows)
    for step in range(steps):
        left = np.maximum(1 + share * (result - 1)[:, None], MIN_LIGHT)
        c, var = light[0] / left, variance[0] / left**2
        slope = share / left
        matrix, right = np.zeros((rows, rows)), np.zeros(rows)
        for lag in (1, 2, 4, 8, 16):
            texture = ROW_TEXTURES[min(step, 4)] * np.sqrt(lag)
            for a in range(rows - lag):
                b = a + lag
                difference, mean = c[b] - c[a], (c[b] + c[a]) / 2
                weight = (mean > 0) / ((texture * mean) ** 2 + difference**2 + var[a] + var[b])
                from_a, from_b = mean * slope[a], mean * slope[b]
                matrix[a, a] += weight @ from_a**2
                matrix[b, b] += weight @ from_b**2
                matrix[a, b] -= weight @ (from_a * from_b)
                matrix[b, a] = matrix[a, b]
                right[a] -= weight @ (from_a * difference)
                right[b] += weight @ (from_b * difference)
        information = np.diagonal(matrix).copy()
        if not information.max() > 0:
            break
        if basis is not None:
            normal = basis.T @ matrix @ basis
            normal += 1e-6 * np.trace(normal) / len(normal) * np.eye(len(normal))
            change = basis @ np.linalg.solve(normal, basis.T @ right)
            result = result + change * 0.5 / max(0.5, np.abs(change).max())
            continue
        hold = 1e-4 * information.max()
        if np.isfinite(deviation):
            hold = 1 / deviation**2
            matrix, right = 0.1 * matrix, 0.1 * right + hold * (row_light - result)
        change = np.linalg.solve(matrix + hold * np.eye(rows), right)
        result = np.maximum(result + np.clip(change, -0.5, 0.5), 0)
    return result, information


VARIATION, MIN_SLOPE, BLOCK, REACH = 40.0, 1e-3, 8, 40.0
ITERATIONS = (4, 12, 20, 40)


def merge_columns(
    stored: npt.NDArray[Any], merged: int, light: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Means of the unsaturated pixels of ``merged`` neighbouring columns, and their variance, by tables of values."""
    means, spreads = [], []
    for first in range(0, stored.shape[1], merged):
        part = stored[:, first : first + merged]
        known = np.isfinite(variance[part])
        count = known.sum(axis=1)
        sums = np.where(known, light[part], 0).sum(axis=1), np.where(known, variance[part], 0).sum(axis=1)
        means.append(sums[0] / np.maximum(count, 1))
        spreads.append(np.where(count > 0, sums[1] / np.maximum(count, 1) ** 2, np.inf))
    return np.stack(means, axis=1), np.stack(spreads, axis=1)


def restore_picture(
    stored: npt.NDArray[Any],
    share: FloatArray,
    block_rows: int,
    block_columns: int,
    rows: FloatArray,
    level: float,
    max_gain: float,
    light: FloatArray,
    variance: FloatArray,
    bounds: FloatArray,
) -> tuple[npt.NDArray[Any], npt.NDArray[np.uint8], FloatArray]:
    """v (1 + q (level - 1))/(1 + q (L - 1)), marks, and the shares of blocks interpolated between their centres."""
    centres = [
        block * (np.arange(n) + 0.5) - 0.5 for n, block in zip(share.shape, (block_rows, block_columns), strict=True)
    ]
    down = np.stack([np.interp(np.arange(len(rows)), centres[0], values) for values in share.T], axis=1)
    each = np.stack([np.interp(np.arange(stored.shape[1]), centres[1], values) for values in down])
    gain = (1 + each * (level - 1)) / np.maximum(1 + each * (rows[:, None] - 1), 1e-9)
    saturated = np.isinf(variance[stored])
    marks = np.where(saturated, 1, np.where(gain > max_gain, 2, 0))
    values = np.searchsorted(bounds, light[stored] * np.minimum(gain, max_gain), side="right")
    return np.where(saturated, stored, values).astype(stored.dtype), marks.astype(np.uint8), each


def subtract_still(
    frames: npt.ArrayLike, camera: Camera, *, still: npt.ArrayLike | None = None, neighbours: int = 8
) -> FloatArray:
    """Subtract the still picture, or the mean of the nearest frames in time, and add the mean of what is subtracted."""
    light = [linear_light(np.asarray(frame), camera) for frame in np.asarray(frames)]
    taken = []
    for k in range(len(light)):
        nearest = sorted(set(range(len(light))) - {k}, key=lambda other: (abs(other - k), other))[:neighbours]
        others = [light[other] for other in nearest]
        taken.append(np.mean(others, axis=0) if still is None else linear_light(np.asarray(still), camera))
    return np.asarray(np.array(light) - np.array(taken) + np.mean(taken))


def smoothing_step(
    pull: FloatArray, weight: FloatArray, share: FloatArray, trend: tuple[FloatArray, ...]
) -> tuple[FloatArray, Pair]:
    """Change of (rows, columns) shares, and the trend of their slopes for the next step."""
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
    """Conjugate gradients, started from the solution for sums of 2 x 2 pixels."""
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
    """Mean of the neighbouring slopes weighted by their couplings, for each block of 8 x 8 pixels."""
    sums, counts = (_around(_before(values, axis)) for values in (coupling * slope, coupling))
    slow = np.where(counts > 0, sums / np.where(counts > 0, counts, 1.0), 0.0)
    return np.asarray(slow.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)[: shape[0], : shape[1]])


def _around(values: FloatArray) -> FloatArray:
    """Sums of blocks, neighbours weighted by exp(-distance/reach), twice in each direction."""
    starts = [np.arange(0, length, BLOCK) for length in values.shape]
    blocks = np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)
    down, across = (
        np.exp(-np.abs(np.subtract.outer(np.arange(n), np.arange(n))) * BLOCK / REACH) for n in blocks.shape
    )
    return np.asarray(down @ (down @ blocks @ across) @ across)


def _halved(values: FloatArray, axis: int) -> FloatArray:
    """Sums of pairs."""
    if values.size == 0:
        return np.zeros(tuple((n + 1) // 2 if k == axis else n for k, n in enumerate(values.shape)))
    return np.asarray(np.add.reduceat(values, np.arange(0, values.shape[axis], 2), axis=axis))


def _before(values: FloatArray, axis: int) -> FloatArray:
    """Differences at their first pixel."""
    return np.pad(values, [(0, 1 if k == axis else 0) for k in (0, 1)])


def _after(values: FloatArray, axis: int) -> FloatArray:
    """Differences at their second pixel."""
    return np.pad(values, [(1 if k == axis else 0, 0) for k in (0, 1)])


def _without_last(values: FloatArray, axis: int) -> FloatArray:
    return np.take(values, range(values.shape[axis] - 1), axis=axis)


def _without_first(values: FloatArray, axis: int) -> FloatArray:
    return np.take(values, range(1, values.shape[axis]), axis=axis)


SLOWEST_ROWS, MOST_CYCLES, GROUPS, TEXTURE, FLOOR = 128, 16, 24, 0.05, 0.01


def row_misfit(light: FloatArray, variance: FloatArray, row_light: FloatArray, share: FloatArray, lag: int) -> float:
    """Misfit of rows ``lag`` apart of (frames, rows, columns) after division by (frames, rows) of mean 1.

    ``share`` broadcasts to (rows, columns).
    """
    left = np.maximum(1 + share * (row_light[:, :, None] - 1), 0.02)
    return _misfit(light / left, variance / left**2, lag)


def _misfit(light: FloatArray, variance: FloatArray, lag: int) -> float:
    """Mean of log(texture^2 + relative difference^2) of rows ``lag`` apart of (..., rows, columns)."""
    after, before = light[..., lag:, :], light[..., :-lag, :]
    mean = 0.5 * (after + before)
    spread = (after - before) ** 2 + variance[..., lag:, :] + variance[..., :-lag, :]
    known = (mean > 0.0) & np.isfinite(spread)
    return float(np.mean(np.log(TEXTURE**2 + spread[known] / mean[known] ** 2))) if known.any() else 0.0


def judge_cleaning(
    light: FloatArray, variance: FloatArray, row_light: FloatArray, share: FloatArray
) -> tuple[float, float, float, float, float, float]:
    """Compare (rows, columns) before and after division by the (rows,) light with its shares of each pixel.

    Returns the light left, the change of texture in dB, the gain, the share of groups of columns that are worse, the
    level and the energy of the swing.
    """
    left = np.maximum(1 + share * (row_light[:, None] - 1), 1 / 8)
    after = light / left
    lag = comparison_lag(row_light[None])
    pairs = ((light, variance), (after, variance / left**2))
    whole = [_misfit(values, spread, lag) for values, spread in pairs]
    parts = np.array_split(np.arange(left.shape[1]), min(GROUPS, left.shape[1]))
    grown = [
        np.diff([_misfit(values[:, part], spread[:, part], lag) for values, spread in pairs]) > 0 for part in parts
    ]
    kept = np.isfinite(variance) & (left > 1 / 8)
    first, second = _group_means(light, np.isfinite(variance)), _group_means(after, kept)
    course = _course(row_light)
    swings, swings_left = course.T @ first, course.T @ second
    energy, mean = float((swings**2).sum()), swings.mean(axis=1)
    return (
        float(np.sqrt((swings_left**2).sum() / energy)) if energy > 0 else 0.0,
        _decibels(_texture(after, kept), _texture(light, kept)),
        whole[0] - whole[1],
        float(np.mean(grown)),
        float(mean @ mean) * swings.shape[1] / energy if energy > 0 else 1.0,
        energy,
    )


def _group_means(light: FloatArray, kept: npt.NDArray[np.bool_]) -> FloatArray:
    """(rows, groups) mean light of groups of columns; the mean of the group in rows that lack pixels."""
    starts = np.unique(np.linspace(0, light.shape[1], GROUPS, endpoint=False).astype(int))
    sums = np.add.reduceat(np.where(kept, light, 0.0), starts, axis=1)
    counts = np.add.reduceat(kept, starts, axis=1, dtype=np.int64)
    whole = counts >= np.maximum(0.8 * counts.max(axis=0), 1)
    values = sums / np.maximum(counts, 1)
    means = np.where(whole, values, 0.0).sum(axis=0) / np.maximum(whole.sum(axis=0), 1)
    return np.asarray(np.where(whole, values, means))


def _course(rows: FloatArray) -> FloatArray:
    """(rows, 2): orthonormal course of the row light and its derivative, which a shift adds, without slow changes."""
    slow, _ = np.linalg.qr(
        np.cos(np.pi * np.outer((np.arange(len(rows)) + 0.5) / len(rows), np.arange(1 + 2 * len(rows) // SLOWEST_ROWS)))
    )
    terms = np.stack([rows - rows.mean(), np.gradient(rows)], axis=1)
    fast = terms - slow @ (slow.T @ terms)
    u, sizes, _ = np.linalg.svd(fast, full_matrices=False)
    return np.asarray(u * (sizes > 1e-9 * max(float(sizes.max()), 1e-300)))


def _texture(light: FloatArray, kept: npt.NDArray[np.bool_]) -> float:
    """Energy of the mixed differences of log light over rows and columns, in which bands and gains cancel."""
    across = np.diff(np.log(np.maximum(light, 0.0) + FLOOR * max(float(light.mean()), 1e-300)), axis=1)
    valid = kept[1:, 1:] & kept[:-1, 1:] & kept[1:, :-1] & kept[:-1, :-1]
    mixed = (across[1:] - across[:-1])[valid]
    return float(np.mean(mixed**2)) if mixed.size else 0.0


def _decibels(after: float, before: float) -> float:
    return float(10 * np.log10(after / before)) if after > 0 and before > 0 else 0.0


def common_course(light: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cosine modes 1 to K of the log light that the (rows, columns) have in common, and their jackknife variance.

    Differences of blocks of pixels some apart in one column are fitted with weights 1/(texture^2 + noise + rest^2),
    since edges are few; the texture decreases from step to step, so that bands are not taken for edges.
    """
    count = max(min(24, len(light) // 4), int(np.ceil(4 * min(1.1 * len(light) / SLOWEST_ROWS, MOST_CYCLES))))
    down, along = max(1, len(light) // (4 * count)), -(-light.shape[1] // 64)
    blocks, noise = _neighbour_means(*_neighbour_means(light, variance, down), along, axis=1)
    known = blocks[np.isfinite(noise)]
    usable = np.maximum(blocks, 1e-3 * max(float(known.mean()) if known.size else 0.0, 1e-100))
    modes = np.cos(np.pi * np.outer((np.arange(len(blocks)) + 0.5) / len(blocks), np.arange(1, count + 1)))

    def pairs(values: FloatArray, sign: int) -> FloatArray:
        return np.concatenate([values[lag:] + sign * values[:-lag] for lag in (1, 2, 4, 8) if lag < len(values)])

    change, design, spread = pairs(np.log(usable), -1), pairs(modes, -1), pairs(noise / usable**2, 1)

    def solved(weight: FloatArray, kept: npt.NDArray[np.intp]) -> FloatArray:
        normal = design.T @ (weight[:, kept].sum(axis=1)[:, None] * design)
        normal += np.eye(count) * 1e-6 * max(np.trace(normal) / count, 1e-300)
        return np.linalg.solve(normal, design.T @ (weight * change)[:, kept].sum(axis=1))

    every, course = np.arange(change.shape[1]), np.zeros(count)
    for step in range(12):
        weight = 1 / ((0.03 * max(1, 6 - step)) ** 2 + spread + (change - (design @ course)[:, None]) ** 2)
        course = solved(weight, every)
    groups = np.array_split(every, min(12, len(every)))
    if len(groups) == 1:
        return course, np.full(count, 1e-8)
    others = np.array([solved(weight, np.setdiff1d(every, group)) for group in groups])
    return course, (len(groups) - 1) * others.var(axis=0) + 1e-8


def _neighbour_means(
    light: FloatArray, variance: FloatArray, count: int, axis: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Means of ``count`` neighbours of finite variance, and their variance."""
    starts = np.arange(0, light.shape[axis], count)
    known = np.isfinite(variance)
    sums, noise, number = (
        np.add.reduceat(np.where(known, values, 0.0), starts, axis=axis)
        for values in (light, variance, np.ones(light.shape))
    )
    return sums / np.maximum(number, 1), np.where(number > 0, noise / np.maximum(number, 1) ** 2, np.inf)
