"""The still picture of a video, subtracted, in plain NumPy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.reference.camera import linear_light

FloatArray = npt.NDArray[np.float64]


def subtract_still(
    frames: npt.ArrayLike, camera: Camera, *, still: npt.ArrayLike | None = None, neighbours: int = 8
) -> FloatArray:
    """Subtract the still picture, or the mean of the nearest frames in time, and add the mean of what is subtracted."""
    light = [linear_light(np.asarray(frame), camera) for frame in np.asarray(frames)]
    taken = []
    for k in range(len(light)):
        nearest = sorted(set(range(len(light))) - {k}, key=lambda other: (abs(other - k), other))[:neighbours]
        others = [light[other] for other in nearest]
        taken.append(np.mean(others, axis=0) if still is None else linear_light(np.asarray(still), camera))
    return np.asarray(np.array(light) - np.array(taken) + np.mean(taken))
