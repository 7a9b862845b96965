"""Stored pixel values to linear light."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.checks import checked


@checked
def linear_light(stored: npt.NDArray[Any], camera: Camera) -> npt.NDArray[np.float64]:
    """Convert stored values to linear light, DN above dark; unsigned integers by a table of all values."""
    if camera.tone_curve == "linear":
        light = stored.astype(np.float64)
        light -= camera.dark_level
        return light
    if stored.dtype.kind == "u":
        top = int(np.iinfo(stored.dtype).max)
        return np.asarray(_curve(np.arange(top + 1, dtype=np.float64), camera, float(top))[stored])
    return _curve(stored.astype(np.float64), camera, 1.0)


def _curve(values: npt.NDArray[np.float64], camera: Camera, largest: float) -> npt.NDArray[np.float64]:
    span = (largest if camera.white_level is None else camera.white_level) - camera.dark_level
    share = (values - camera.dark_level) / span
    size = np.abs(share)
    if camera.tone_curve == "gamma":
        light = size**camera.gamma
    else:
        light = np.where(size <= 0.04045, size / 12.92, ((size + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.copysign(light, share) * span)
