"""Outline and tone of a short light together, in plain NumPy.

The tone is a weighted least-squares fit by singular values, the longest run of rows a search of all; the core uses
the Cholesky factor of the normal equations and running sums.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

ROUNDS, REACH, ASCENTS = 6, 0.12, 3
MOST_ORDERS, OUTLIER, SMALLEST_SPREAD, MIN_BEYOND = 3, 9.0, 1e-3, 4


def fit_tone(profile: FloatArray, weight: FloatArray, frequency: float) -> tuple[FloatArray, FloatArray, float]:
    """The slow part (rows), all of the fit (rows), and the weighted energy of the tone.

    Mean, slope and curvature, then up to three harmonics, whose amplitude may change along the rows.
    """
    rows = np.arange(len(profile))
    along = 2 * rows / len(profile) - 1
    slow = np.stack([np.ones(len(rows)), along, along**2], axis=1)
    orders = 1 + np.arange(np.clip(int(0.499 / frequency), 1, MOST_ORDERS))
    angles = 2 * np.pi * frequency * np.outer(rows, orders)
    both = np.concatenate([slow, np.cos(angles), np.sin(angles)], axis=1)
    of_slow = _solved(slow, profile, weight)
    tone = _solved(both, profile, weight) - of_slow
    fitted = _solved(np.column_stack([both, along * tone]), profile, weight)
    return of_slow, fitted, float(np.sum(weight * ((profile - of_slow) ** 2 - (profile - fitted) ** 2)))


def fit_outline(light: FloatArray, own: BoolArray, frequency: float) -> tuple[float, BoolArray] | None:
    """Frequency, cycles per row, and own pixels of log light (rows, groups), alternately; absent if they do not settle.

    Given the tone, each group's own rows are those of the largest sum of log likelihood ratios against texture that
    swings as much and against what lies above and below; given them, the frequency is that of most energy.
    """
    own = own.copy()
    light, profile, weight = _centred(light, own, np.zeros(len(light)))
    for _ in range(ROUNDS):
        lower, upper = frequency * (1 - REACH), min(frequency * (1 + REACH), 0.499)
        frequency = _strongest(profile, weight, lower, upper)
        if not lower < frequency < upper:
            return None
        slow, fitted, _ = fit_tone(profile, weight, frequency)
        light, profile, weight = _centred(light, own, fitted)
        before, own = own, _selected(_ratios(light, own, slow, fitted), frequency)
        light, profile, weight = _centred(light, own, fitted)
        if not own.any():
            return None
        if np.array_equal(own, before):
            break
    return frequency, own


def _solved(terms: FloatArray, profile: FloatArray, weight: FloatArray) -> FloatArray:
    root = np.sqrt(weight)
    return np.asarray(terms @ np.linalg.lstsq(root[:, None] * terms, root * profile, rcond=3e-5)[0])


def _strongest(profile: FloatArray, weight: FloatArray, lower: float, upper: float) -> float:
    lit = np.flatnonzero(weight)
    if len(lit) == 0:
        return lower
    own = slice(lit[0], lit[-1] + 1)
    profile, weight, rows = profile[own], weight[own], lit[-1] + 1 - lit[0]
    step, fine = 0.125 / rows, 0.02 / rows

    def energy(f: float) -> float:
        return fit_tone(profile, weight, f)[2]

    grid = np.minimum(lower + step * np.arange(int((upper - lower) / step) + 2), upper)
    best = float(grid[np.argmax([energy(f) for f in grid])])
    if not lower < best < upper:
        return best
    for _ in range(ASCENTS):
        below, here, above = energy(best - fine), energy(best), energy(best + fine)
        bend = 2 * here - below - above
        best += float(np.clip(0.5 * fine * (above - below) / bend if bend > 0 else best, -0.5 * step, 0.5 * step))
    return best


def _centred(light: FloatArray, own: BoolArray, wanted: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Each group less the mean over its own pixels, but for `wanted`; their mean in each row, and their number."""
    counts, weight = own.sum(axis=0), own.sum(axis=1).astype(np.float64)
    moves = np.sum(np.where(own, light - wanted[:, None], 0.0), axis=0) / np.maximum(counts, 1)
    light = light - moves
    return light, np.sum(np.where(own, light, 0.0), axis=1) / np.maximum(weight, 1.0), weight


def _log_density(x: FloatArray, mean: FloatArray | float, variance: float) -> FloatArray:
    return np.asarray(-0.5 * np.log(variance) - 0.5 * np.minimum((x - mean) ** 2 / variance, OUTLIER))


def _ratios(light: FloatArray, own: BoolArray, slow: FloatArray, fitted: FloatArray) -> FloatArray:
    lit = own.any(axis=1)
    tone = fitted - slow
    residuals = np.sort(np.abs(light - fitted[:, None])[own])
    variance = max(float(residuals[len(residuals) // 2] / 0.6745) ** 2, SMALLEST_SPREAD**2)
    swing = float(np.sum(own.sum(axis=1) * tone**2)) / own.sum()
    level = np.clip(slow, slow[lit].min(), slow[lit].max())
    ratios = np.zeros(light.shape)
    for g in np.flatnonzero(own.any(axis=0)):
        x, rows = light[:, g], np.flatnonzero(own[:, g])
        first, end = rows[0], rows[-1] + 1
        other = _log_density(x, level, variance + swing)
        upper = 2 * np.arange(len(x)) < first + end
        for side, near in ((x[:first], upper), (x[end:], ~upper)):
            if len(side) >= MIN_BEYOND:
                beyond = _log_density(x, float(side.mean()), max(float(side.var()), SMALLEST_SPREAD**2))
                other = np.where(near, np.maximum(other, beyond), other)
        ratios[:, g] = _log_density(x, level + tone, variance) - other
    return ratios


def _selected(ratios: FloatArray, frequency: float) -> BoolArray:
    """Each group with its neighbours: a run of at least a cycle of rows; then the best run of groups."""
    groups = ratios.shape[1]
    own, of_groups = np.zeros(ratios.shape, bool), np.full(groups, -1e3)
    for g in range(groups):
        first, end = _largest_run(ratios[:, max(g - 1, 0) : g + 2].sum(axis=1))
        if (end - first) * frequency >= 1:
            own[first:end, g] = True
            of_groups[g] = ratios[first:end, g].sum()
    left, right = _largest_run(of_groups)
    own[:, :left] = own[:, right:] = False
    return own


def _largest_run(values: FloatArray) -> tuple[int, int]:
    """The run [first, end) of the largest sum, the shortest of equal ones; empty if no value is positive."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    gains = np.tril(sums[:, None] - sums, -1)[:, ::-1]  # by the end, then from the latest first one
    end, back = np.unravel_index(np.argmax(gains), gains.shape)
    return (len(values) - int(back), int(end)) if gains[end, back] > 0 else (0, 0)
