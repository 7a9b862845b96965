"""Conversion of linear light to stored values, and the slope of the tone curve."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera

FloatArray = npt.NDArray[np.float64]


def white_level(camera: Camera, dtype: np.dtype[Any]) -> float:
    """Stored value of full light: the camera's, or the largest of the type (1 for floats)."""
    if camera.white_level is not None:
        return camera.white_level
    return float(np.iinfo(dtype).max) if dtype.kind in "ui" else 1.0


def to_stored(light: FloatArray, camera: Camera, dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    """The inverse of :func:`ocisac_fast.camera.linear_light`, rounded and clipped to the type."""
    values = light
    if camera.tone_curve != "linear":
        span = white_level(camera, dtype) - camera.dark_level
        v = np.abs(light) / span
        curve = v ** (1 / camera.gamma) if camera.tone_curve == "gamma" else _light_to_srgb(v)
        values = np.copysign(span * curve, light)
    values = values + camera.dark_level
    if dtype.kind in "ui":
        values = np.clip(np.rint(values), np.iinfo(dtype).min, np.iinfo(dtype).max)
    return values.astype(dtype)


def light_per_step(stored: npt.NDArray[Any], camera: Camera) -> FloatArray:
    """Slope of the tone curve: change of linear light per stored step, at least 1/50 of its mean.

    The lower bound keeps the noise variance of black pixels, where a power has slope 0, above 0.
    """
    if camera.tone_curve == "linear":
        return np.ones(stored.shape)
    span = white_level(camera, stored.dtype) - camera.dark_level
    v = np.abs(np.asarray(stored, np.float64) - camera.dark_level) / span
    if camera.tone_curve == "gamma":
        slope = camera.gamma * np.maximum(v, 1e-6) ** (camera.gamma - 1)
    else:
        slope = np.where(v <= 0.04045, 1 / 12.92, 2.4 / 1.055 * ((v + 0.055) / 1.055) ** 1.4)
    return np.maximum(slope, 0.02)


def _light_to_srgb(v: FloatArray) -> FloatArray:
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 0.0031308) ** (1 / 2.4) - 0.055)
