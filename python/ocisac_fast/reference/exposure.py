"""The exposure's objectives by brute force: maxima on refined grids, modulation over a grid of phases, flicker."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.exposure.choice import BestExposure
from ocisac_fast.exposure.flicker import FlickeringLight
from ocisac_fast.exposure.flicker_indices import FlickerIndices
from ocisac_fast.light.waveforms import SquareWave, Tone, Waveform
from ocisac_fast.reference.light import integrate_exposure


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
    """Maximum of the objective on a grid; ``"exact"`` refines the grid twice, by 200, about the best points."""
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
        grid = _refined_grid(objective, low, high, f.max())
    grid = grid[grid > 0]
    values = objective(grid)
    return float(grid[values.argmax()]), float(values.max())


def _refined_grid(objective: Callable[[Float64s], Float64s], low: float, high: float, highest: float) -> Float64s:
    """A grid of 400 points a cycle of the highest frequency, refined twice, by 200, about its best points."""
    width = (high - low) / max(20_000, int(400 * highest * (high - low)))
    grid = np.append(np.arange(low, high, width) if width > 0.0 else [], high)
    for _ in range(3):
        best = grid[np.argsort(objective(grid))[-8:]]
        fine = (best[:, None] + width * np.linspace(-1, 1, 401)).ravel()
        grid, width = np.append(best, fine[(fine >= low) & (fine <= high)]), width / 200
    return grid


def best_noisy_exposure(
    frequencies: npt.ArrayLike,
    weights: npt.ArrayLike,
    bounds: tuple[float, float],
    *,
    noise_exposure: float = math.inf,
    step: float = 0.0,
) -> BestExposure:
    """Maximum of J on a grid refined twice, by 200, about its best points; or over all multiples."""
    f, w = np.asarray(frequencies, np.float64), np.asarray(weights, np.float64)

    def objective(exposures: npt.NDArray[Any]) -> Float64s:
        tones = np.abs(np.sin(np.pi * np.multiply.outer(exposures, f))) @ (w / (np.pi * f))
        return np.asarray(tones / np.sqrt(1.0 + exposures / noise_exposure))

    low, high = bounds
    if step > 0.0:
        grid = step * np.arange(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
        grid = grid[grid > 0.0]
    else:
        grid = _refined_grid(objective, low, high, f.max())
    values = objective(grid)
    return BestExposure(float(grid[values.argmax()]), float(values.max()))


_PHASES = 64  # from the phase symmetric about the middle of the exposure, which is a maximum or a minimum


def exposure_modulation(light: FlickeringLight, exposure: npt.ArrayLike, frequencies: int = 11) -> Float64s:
    """(max - min) / (max + min) of the mean light over 64 phases and several frequencies within the uncertainty."""
    times = np.asarray(exposure, dtype=np.float64)
    spread = np.linspace(-1.0, 1.0, frequencies) if light.uncertainty > 0.0 else np.zeros(1)
    tried = light.frequency + spread * light.uncertainty
    each = [max(_modulation(light, float(f), float(time)) for f in tried) for time in times.ravel()]
    return np.array(each).reshape(times.shape)


def _modulation(light: FlickeringLight, frequency: float, exposure: float) -> float:
    wave: Waveform = Tone(frequency, depth=light.depth)
    if light.duty is not None:
        wave = SquareWave(frequency, duty=light.duty, amplitude=2.0 * light.depth) + (1.0 - light.depth)
    camera = Camera(row_time=1.0 / (_PHASES * frequency), exposure=exposure)
    means = integrate_exposure(wave, camera, _PHASES, start=exposure / 2)
    return float((means.max() - means.min()) / (means.max() + means.min()))


_STEPS = 1 << 20


def flicker_indices(
    light: FlickeringLight,
    exposure: npt.ArrayLike,
    *,
    background: float = 0.0,
    contrast: float = 0.1,
    tolerance: float = 0.1,
    phases: int = 1_000_000,
    seed: int = 0,
) -> FlickerIndices:
    """Estimate from ``phases`` exposures that end at random multiples of 2^-20 of a period."""
    times = np.asarray(exposure, dtype=np.float64)
    rows = np.random.default_rng(seed).integers(0, _STEPS, phases)
    dark = (1.0 - light.depth) / (1.0 + light.depth)
    wave: Waveform = Tone(light.frequency, amplitude=2.0 / (1.0 + light.depth), depth=light.depth)
    if light.duty is not None:
        wave = SquareWave(light.frequency, duty=light.duty, amplitude=1.0 - dark) + dark
    found = []
    for time in times.ravel():
        lamp = integrate_exposure(wave, Camera(1.0 / (_STEPS * light.frequency), float(time)), rows)
        level = lamp + background
        mean = level.mean()
        found.append(
            (
                (level.max() - level.min()) / (level.max() + level.min()),
                np.mean(level - background > contrast * background),
                np.mean(np.abs(level - mean) < tolerance * mean),
                np.mean(lamp <= 1e-12),
            )
        )
    return FlickerIndices(*(np.reshape(column, times.shape) for column in zip(*found, strict=True)))
