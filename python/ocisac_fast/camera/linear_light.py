"""Stored pixel values to linear light and back, and where they saturate; the core holds the curves."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import checked


@checked
def linear_light(stored: npt.NDArray[Any], camera: Camera) -> Float64s:
    """Convert stored values to linear light, DN above dark; unsigned integers by a table of all values."""
    stored = np.asarray(stored)
    if camera.tone_curve == "linear":
        light = stored.astype(np.float64)
        light -= camera.dark_level
        return light
    top = type_maximum(stored.dtype)
    if stored.dtype.kind != "u":
        return _core.linear_light(stored, camera._handle, top)
    return np.asarray(_core.linear_light(np.arange(top + 1), camera._handle, top)[stored])


def stored_values(light: npt.NDArray[Any], camera: Camera, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """The inverse of :func:`linear_light`, rounded and clipped to the type."""
    dtype = np.dtype(dtype)
    values = _core.stored_value(light, camera._handle, type_maximum(dtype))
    if dtype.kind in "ui":
        values = np.clip(np.rint(values), np.iinfo(dtype).min, np.iinfo(dtype).max)
    return values.astype(dtype)


def light_per_step(stored: npt.NDArray[Any], camera: Camera) -> Float64s:
    """Change of linear light for a change of the stored value by 1: the tone curve's slope, at least 1/50 of its mean.

    The floor keeps the noise of black pixels, where a power has no slope, above 0.
    """
    return _core.light_per_step(stored, camera._handle, type_maximum(stored.dtype))


def white_level(camera: Camera, dtype: npt.DTypeLike) -> float:
    """Stored value of full light: the camera's, or the largest of the type (1 for floats)."""
    return type_maximum(dtype) if camera.white_level is None else camera.white_level


def saturation_level(camera: Camera, dtype: npt.DTypeLike) -> float:
    """Stored value from which on a pixel is saturated: 98 % of white above dark; NaN for floats without a white level.

    Lossy files and sharpening scatter clipped pixels below white.
    """
    dtype = np.dtype(dtype)
    level = _core.saturation_level(camera._handle, type_maximum(dtype) if dtype.kind in "ui" else math.nan)
    return math.inf if dtype.kind == "f" and level > float(np.finfo(dtype).max) else level  # no pixel reaches it


def type_maximum(dtype: npt.DTypeLike) -> float:
    """Largest value of a sample: 255, 65535, or 1 for floats."""
    dtype = np.dtype(dtype)
    return float(np.iinfo(dtype).max) if dtype.kind in "ui" else 1.0
