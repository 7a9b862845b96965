"""The direction in which a camera reads its rows, from a picture with a modulated light."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import as_grey_frames
from ocisac_fast.core.checks import checked
from ocisac_fast.core.results import Result
from ocisac_fast.lights.sources import LightSource, detect_sources

_CLEAR_ENERGY = 100.0  # ratio of the lights' energies
_CLEAR_COHERENCE = 5.0  # standard errors
_TIMES_OTHER = 2.0
_TREND = 33  # rows of the running mean that is subtracted
_INDEPENDENT = 16  # rows: correlation length of what remains
_MAX_COLUMNS = 512
_FLOOR = 8 / 255  # of the largest value, in logarithms


@dataclass(frozen=True, slots=True, repr=False)
class ScanAxis(Result):
    """A read-out axis.

    Attributes:
        axis: ``"y"`` or ``"x"``; the direction along it is not found.
        clear: the other axis explains the picture clearly less.
        energy: of the lights found along y and along x, DN^2 times pixels.
        probability: that of the most probable of these lights, along y and along x; 0 without one.
        coherence: correlation of the rows of both halves of the picture, along y and along x, standard errors.
    """

    axis: Literal["y", "x"]
    clear: bool
    energy: tuple[float, float]
    probability: tuple[float, float]
    coherence: tuple[float, float]


@checked
def find_scan_axis(frame: npt.ArrayLike, camera: Camera) -> ScanAxis:
    """Find the axis along which rows are read, from the lights that one frame shows along each.

    The axis whose lights have 100 times the energy of the other's; else the one along which the logarithms of the left
    and the right half of the picture correlate clearly, as under a light that is everywhere; else, with ``clear``
    False, the one with more energy, y without lights.

    Args:
        frame: (rows, columns) as stored.
        camera: dark level and tone curve; its ``scan_axis`` and timing do not matter.

    Returns:
        :class:`ScanAxis`.
    """
    picture = as_grey_frames(frame, "frame", "y", single=True)[0]
    along = {
        axis: dataclasses.replace(camera, row_time=1.0, exposure=None, frame_time=None, scan_axis=axis)
        for axis in ("y", "x")
    }
    lights = [_lights(picture, along[axis]) for axis in ("y", "x")]
    energy, probability = (_energy(lights[0]), _energy(lights[1])), (_largest(lights[0]), _largest(lights[1]))
    coherence = _coherence(picture), _coherence(picture.T)
    by_energy, by_coherence = int(energy[1] > energy[0]), int(coherence[1] > coherence[0])
    if energy[by_energy] > _CLEAR_ENERGY * energy[1 - by_energy]:
        better, clear = by_energy, True
    elif coherence[by_coherence] > max(_CLEAR_COHERENCE, _TIMES_OTHER * coherence[1 - by_coherence]):
        better, clear = by_coherence, True
    else:
        better, clear = by_energy, False
    return ScanAxis("x" if better else "y", clear, energy, probability, coherence)


def _lights(picture: npt.NDArray[np.generic], camera: Camera) -> list[LightSource]:
    return [light for light in detect_sources(picture, camera) if light.reflection_of is None]


def _energy(lights: list[LightSource]) -> float:
    return float(sum(light.probability * light.amplitude**2 * light.width * light.height for light in lights))


def _largest(lights: list[LightSource]) -> float:
    return max((light.probability for light in lights), default=0.0)


def _coherence(picture: npt.NDArray[np.generic]) -> float:
    """Fisher's z of the correlation of the two halves' rows, over its standard error."""
    rows, columns = picture.shape
    if rows <= _TREND or columns < 2:
        return 0.0
    light = np.asarray(picture[:, :: max(1, columns // _MAX_COLUMNS)], np.float64)
    logs = np.log(np.maximum(light, 0.0) + _FLOOR * max(float(light.max()), 1e-300))
    halves = np.stack([half.mean(axis=1) for half in np.array_split(logs, 2, axis=1)])
    ends = np.pad(halves, ((0, 0), (_TREND // 2, _TREND // 2)), "edge")
    fast = halves - np.stack([np.convolve(one, np.full(_TREND, 1 / _TREND), "valid") for one in ends])
    norm = float(np.sqrt((fast[0] @ fast[0]) * (fast[1] @ fast[1])))
    correlation = float(fast[0] @ fast[1]) / norm if norm > 0 else 0.0
    return float(np.arctanh(np.clip(correlation, -0.999, 0.999)) * np.sqrt(rows / _INDEPENDENT))
