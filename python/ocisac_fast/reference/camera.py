"""Stored pixel values to linear light, and without the still picture."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera


def type_maximum(dtype: npt.DTypeLike) -> float:
    """Largest value of a sample: 255, 65535, or 1 for floats."""
    dtype = np.dtype(dtype)
    return float(np.iinfo(dtype).max) if dtype.kind in "ui" else 1.0


def linear_light(stored: npt.NDArray[np.generic], camera: Camera) -> npt.NDArray[np.float64]:
    """Light in DN above dark: (white - dark) curve((v - dark)/(white - dark))."""
    above_dark = np.asarray(stored, dtype=np.float64) - camera.dark_level
    if camera.tone_curve == "linear":
        return above_dark
    white = type_maximum(stored.dtype) if camera.white_level is None else camera.white_level
    v = np.abs(above_dark) / (white - camera.dark_level)
    if camera.tone_curve == "gamma":
        curve = v**camera.gamma
    elif camera.tone_curve == "hlg":
        a = 0.17883277
        c = 0.5 - a * np.log(4 * a)
        curve = np.where(v <= 0.5, v**2 / 3, (np.exp((v - c) / a) + 1 - 4 * a) / 12)
    elif camera.tone_curve == "pq":
        p = v ** (32 / 2523)
        curve = (np.maximum(p - 0.8359375, 0) / (18.8515625 - 18.6875 * p)) ** (16384 / 2610)
    else:
        curve = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.copysign(curve, above_dark) * (white - camera.dark_level))


def saturation_level(stored: npt.NDArray[np.generic], camera: Camera) -> float:
    """Stored value from which a pixel is saturated; NaN (never) for floats without a white level.

    98 % of white above dark: lossy files and sharpening scatter clipped pixels.
    """
    if camera.white_level is None and stored.dtype.kind == "f":
        return float("nan")
    white = type_maximum(stored.dtype) if camera.white_level is None else camera.white_level
    return camera.dark_level + 0.98 * (white - camera.dark_level)


def subtract_still(
    frames: npt.ArrayLike, camera: Camera, *, still: npt.ArrayLike | None = None, neighbours: int = 8
) -> npt.NDArray[np.float64]:
    """Subtract the still picture, or the mean of the nearest frames in time, and add the mean of what is subtracted."""
    light = [linear_light(np.asarray(frame), camera) for frame in np.asarray(frames)]
    taken = []
    for k in range(len(light)):
        nearest = sorted(set(range(len(light))) - {k}, key=lambda other: (abs(other - k), other))[:neighbours]
        others = [light[other] for other in nearest]
        taken.append(np.mean(others, axis=0) if still is None else linear_light(np.asarray(still), camera))
    return np.asarray(np.array(light) - np.array(taken) + np.mean(taken))
