"""Modulation by the exposure integral over a grid of phases and frequencies, and its bound by search on a grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.exposure.flicker import FlickerFreeExposure, FlickeringLight
from ocisac_fast.light.waveforms import SquareWave, Tone, Waveform
from ocisac_fast.reference.waveforms import integrate_exposure

Float64s = npt.NDArray[np.float64]

_PHASES = 64  # from the one symmetric about the middle of the exposure, where a maximum or a minimum lies


def exposure_modulation(light: FlickeringLight, exposure: npt.ArrayLike, frequencies: int = 11) -> Float64s:
    """(max - min) / (max + min) of the mean light over 64 phases and some frequencies within the uncertainty."""
    times = np.asarray(exposure, dtype=np.float64)
    spread = np.linspace(-1.0, 1.0, frequencies) if light.uncertainty > 0.0 else np.zeros(1)
    tried = light.frequency + spread * light.uncertainty
    each = [max(_modulation(light, float(f), float(time)) for f in tried) for time in times.ravel()]
    return np.array(each).reshape(times.shape)


def flicker_free_exposure(
    lights: Sequence[FlickeringLight],
    below: float,
    *,
    near: float | None = None,
    bounds: tuple[float, float] = (0.0, 0.1),
    points: int = 1001,
) -> FlickerFreeExposure:
    """The nearest or shortest exposure of a grid that holds, else the one of the smallest modulation."""
    grid = np.linspace(bounds[0], bounds[1], points)
    grid = grid[grid > 0.0]
    each = np.array([exposure_modulation(light, grid) for light in lights])
    left = each.max(axis=0)
    good = np.flatnonzero(left <= below)
    tried, cost = (good, np.abs(grid[good] - (near or 0.0))) if good.size else (np.arange(grid.size), left)
    chosen = tried[cost.argmin()]
    return FlickerFreeExposure(
        float(grid[chosen]), float(left[chosen]), bool(good.size), tuple(each[:, chosen].tolist())
    )


def _modulation(light: FlickeringLight, frequency: float, exposure: float) -> float:
    wave: Waveform = Tone(frequency, depth=light.depth)
    if light.duty is not None:
        wave = SquareWave(frequency, light.duty, amplitude=2.0 * light.depth) + (1.0 - light.depth)
    camera = Camera(row_time=1.0 / (_PHASES * frequency), exposure=exposure)
    means = integrate_exposure(wave, camera, _PHASES, start=exposure / 2)
    return float((means.max() - means.min()) / (means.max() + means.min()))
