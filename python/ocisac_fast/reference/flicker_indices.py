"""The flicker indices of IEEE P2020 as they are computed from frames, over random phases of the exposure integral."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.exposure.flicker import FlickeringLight
from ocisac_fast.exposure.flicker_indices import FlickerIndices
from ocisac_fast.light.waveforms import SquareWave, Tone, Waveform, integrate_exposure

_PHASES = 1 << 20


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
    """From ``phases`` exposures that end at random multiples of 2^-20 of a period."""
    times = np.asarray(exposure, dtype=np.float64)
    rows = np.random.default_rng(seed).integers(0, _PHASES, phases)
    dark = (1.0 - light.depth) / (1.0 + light.depth)
    wave: Waveform = Tone(light.frequency, 2.0 / (1.0 + light.depth), depth=light.depth)
    if light.duty is not None:
        wave = SquareWave(light.frequency, light.duty, 1.0 - dark) + dark
    found = []
    for time in times.ravel():
        lamp = integrate_exposure(wave, Camera(1.0 / (_PHASES * light.frequency), float(time)), rows)
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
