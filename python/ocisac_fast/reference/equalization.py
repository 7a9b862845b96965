"""The equaliser of one column after another, written as its definition."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.reference.light import linear_light

Float64s = npt.NDArray[np.float64]


def equalize(
    columns: npt.ArrayLike,
    camera: Camera,
    method: str = "inverse",
    noise: npt.ArrayLike | None = None,
    *,
    max_boost: float = 10.0,
) -> Float64s:
    """Line off, ends continued by linear prediction, DFT times G, line back half an exposure earlier.

    np.fft, np.linalg and np.polynomial do the work. docs/equalisation.md explains it.
    """
    light = linear_light(np.asarray(columns), camera)
    assert camera.exposure is not None
    exposure_rows = camera.exposure / camera.row_time
    axis = -2 if light.ndim > 1 else 0
    by_column = np.moveaxis(light, axis, -1)
    rows = by_column.shape[-1]
    result = np.empty(by_column.shape)
    if exposure_rows == 0:
        return light
    if exposure_rows >= rows:
        result[...] = by_column.mean(axis=-1, keepdims=True)
        return np.moveaxis(result, -1, axis)
    weights = continuation(rows, exposure_rows)
    levels = np.broadcast_to(np.nan if noise is None else np.asarray(noise, dtype=np.float64), by_column.shape[:-1])
    for index in np.ndindex(*by_column.shape[:-1]):
        level = float(levels[index]) if method == "wiener" else 0.0
        result[index] = _equalize_column(by_column[index], exposure_rows, weights, level, max_boost)
    return np.moveaxis(result, -1, axis)


def lost_frequencies(camera: Camera, max_boost: float = 10.0) -> Float64s:
    """As :func:`ocisac_fast.lost_frequencies`: a fine grid over |sinc|, its crossings refined by bisection."""
    assert camera.exposure is not None
    level, highest, exposure = 1 / (np.sqrt(2) * max_boost), 0.5 / camera.row_time, camera.exposure

    def lost(frequency: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        return np.asarray(np.abs(np.sinc(np.asarray(frequency) * exposure)) < level)

    grid = np.linspace(0, highest, int(2000 * max(highest * exposure, 1)) + 1)
    change = np.flatnonzero(lost(grid[1:]) != lost(grid[:-1]))
    low, high, before = grid[change], grid[change + 1], lost(grid[change])
    for _ in range(60):
        middle = (low + high) / 2
        same = lost(middle) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    edges = [*high, np.inf] if lost(highest) else [*high, highest, np.inf]
    return np.reshape(edges, (-1, 2))


def covariance(rows_apart: npt.ArrayLike, exposure_rows: float) -> Float64s:
    """Covariance of two rows: white light through the exposure, on a smooth course of 100 times its variance."""
    k = np.abs(np.asarray(rows_apart, dtype=np.float64))
    smooth = 100 / (1 + (k / (2 * exposure_rows + 16)) ** 2)
    return np.asarray(np.maximum(0, 1 - k / max(exposure_rows, 1)) + smooth)


def continuation(rows: int, exposure_rows: float) -> Float64s:
    """(predicted, used) weights: rows beyond the end from the last rows, the nearest first; fading out."""
    used = min(int(np.ceil(4 * exposure_rows)) + 16, 1024, rows)
    predicted = min(int(np.ceil(4 * exposure_rows)) + 32, 1024, rows)
    seen, ahead = np.arange(used), np.arange(1, predicted + 1)
    among = covariance(np.subtract.outer(seen, seen), exposure_rows) + 0.001 * max(exposure_rows, 1) * np.eye(used)
    between = covariance(np.add.outer(ahead, seen), exposure_rows)
    fade = 0.5 + 0.5 * np.cos(np.pi * ahead / (predicted + 1))
    return np.asarray(fade[:, None] * np.linalg.solve(among, between.T).T)


def optimal_length(length: int) -> int:
    """The smallest length with no prime factors but 2, 3 and 5 that is not below ``length``."""
    while True:
        rest = length
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return length
        length += 1


def _equalize_column(
    column: Float64s, exposure_rows: float, weights: Float64s, noise: float, max_boost: float
) -> Float64s:
    rows = len(column)
    n = np.arange(rows)
    line = np.polynomial.Polynomial.fit(n, column, 1) if rows > 1 else np.polynomial.Polynomial([column[0]])
    residual = column - line(n)
    predicted, used = weights.shape
    length = optimal_length(rows + 2 * predicted)
    after = weights @ residual[::-1][:used]
    before = (weights @ residual[:used])[::-1]
    extended = np.concatenate([residual, after, np.zeros(length - rows - 2 * predicted), before])
    f = np.arange(length // 2 + 1) / length
    h = np.sinc(f * exposure_rows)
    gain = h / np.maximum(h**2 + _noise_to_light(residual, f, h, exposure_rows, noise), max_boost**-2)
    spectrum = np.fft.rfft(extended) * gain * np.exp(1j * np.pi * f * exposure_rows)
    return np.asarray(np.fft.irfft(spectrum, length)[:rows] + line(n + exposure_rows / 2))


def _noise_to_light(x: Float64s, f: Float64s, h: Float64s, exposure_rows: float, noise: float) -> Float64s:
    """noise^2 / S(f); infinite where no light is seen above the noise."""
    power = noise**2
    if np.isnan(noise):
        power = float(np.mean(np.diff(x, 2) ** 2)) / 6 if len(x) > 2 else 0.0
    if power == 0:
        return np.zeros_like(f)
    light = np.mean(x**2) - power
    if light <= 0:
        return np.full_like(f, np.inf)
    lag = min(max(int(np.ceil(exposure_rows / 4)), 1), len(x) - 1)
    ratio = max((np.mean((x[lag:] - x[:-lag]) ** 2) - 2 * power) / light, 1e-12)
    corners = np.append(np.inf, 0.5 * 2.0 ** (-0.5 * np.arange(20)))
    shapes = 1 / (1 + (f / corners[:, None]) ** 2)
    seen = shapes * h**2
    ratios = (seen * 4 * np.sin(np.pi * f * lag) ** 2).mean(axis=1) / seen.mean(axis=1)
    shape = shapes[np.argmin(np.abs(np.log(ratios / ratio)))]
    return np.asarray(power / light * np.mean(h**2 * shape) / shape)
