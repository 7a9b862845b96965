"""Exposure choice by brute force: the objective on ever finer grids."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from ocisac_fast.exposure.choice import BestExposure

Float64s = npt.NDArray[np.float64]


def exposure_objective(
    exposure: npt.ArrayLike,
    f_comm: npt.ArrayLike,
    f_sense: npt.ArrayLike,
    weights: Sequence[float] = (1, 1),
    more: Sequence[npt.ArrayLike] = (),
) -> float | Float64s:
    """Y(T) = sum_i w_i |sin(pi f_i T)| / (pi f_i), with f_i T reduced to [0, 1) in rational arithmetic."""

    def term(weight: float, frequency: float, time: float) -> float:
        cycles = Fraction(frequency) * Fraction(time)
        return weight * abs(math.sin(math.pi * float(cycles - round(cycles)))) / (math.pi * frequency)

    tones = (f_comm, f_sense, *more)
    each = [np.vectorize(term, otypes=[float])(w, f, exposure) for w, f in zip(weights, tones, strict=True)]
    value: float | Float64s = np.add.reduce(np.broadcast_arrays(*each))
    return value


def best_exposure(
    f_comm: npt.ArrayLike,
    f_sense: npt.ArrayLike,
    method: str = "exact",
    weights: Sequence[float] = (1, 1),
    bounds: tuple[float, float] | None = None,
    step: float | None = None,
    *,
    more: Sequence[npt.ArrayLike] = (),
    points: int = 10001,
) -> BestExposure:
    """The largest objective on a grid; ``"exact"`` looks again, twice, 200 times finer about the best grid points."""
    tones = np.broadcast_arrays(*(np.asarray(f, dtype=np.float64) for f in (f_comm, f_sense, *more)))
    shape = tones[0].shape
    problems = np.stack(tones, axis=-1).reshape(-1, len(tones))
    found = [_one(f, method, np.asarray(weights, dtype=np.float64), bounds, step, points) for f in problems]
    exposures, objectives = np.array(found).reshape(-1, 2).T
    return BestExposure(exposures.reshape(shape)[()], objectives.reshape(shape)[()])


def _one(
    f: Float64s,
    method: str,
    w: Float64s,
    bounds: tuple[float, float] | None,
    step: float | None,
    points: int,
) -> tuple[float, float]:
    def objective(exposure: Float64s) -> Float64s:
        cycles = np.multiply.outer(exposure, f)
        return np.abs(np.sin(np.pi * (cycles - np.rint(cycles)))) @ (w / (np.pi * f))

    low, high = bounds if bounds is not None else (0.0, 1 / f.min())
    ratio = f.max() / f.min()
    if method == "closed-form":
        grid = np.array([(max(np.floor(ratio / 2 - 0.5), 0) + 0.5) / f.max()])
    elif method == "rounded":
        grid = np.array([(np.floor(ratio / 2) + 0.5) / f.max()])
    elif step is not None:
        grid = step * np.arange(max(1, np.ceil(low / step * (1 - 1e-15))), np.floor(high / step * (1 + 1e-15)) + 1)
    elif method == "search":
        grid = np.linspace(low, high, points)
    else:
        width = (high - low) / max(20000, 400 * f.max() * (high - low))
        grid = np.append(np.arange(low, high, width), high)
        for _ in range(3):
            best = grid[np.argsort(objective(grid))[-8:]]
            fine = (best[:, None] + width * np.linspace(-1, 1, 401)).ravel()
            grid, width = np.append(best, fine[(fine >= low) & (fine <= high)]), width / 200
    grid = grid[grid > 0]
    values = objective(grid)
    return float(grid[values.argmax()]), float(values.max())
