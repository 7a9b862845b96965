"""Plain methods in addition to those of the chart (``studies.chart.methods``), in their simplest form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.light.response import exposure_response
from ocisac_fast.tones.gain import tone_gain
from studies.chart.methods import GAIN_METHODS
from studies.chart.scenes import Scene
from studies.limits.catalogue import Point, compared

_CHARTED = {method.name: method for method in GAIN_METHODS}


def _charted(name: str) -> Callable[[Scene, npt.NDArray[Any]], Float64s]:
    """(columns,) gains by a method of the chart."""
    return lambda scene, columns: np.asarray(_CHARTED[name].prepare(scene)(columns), dtype=np.float64)


rounded_bin_gain = _charted("rounded bin, numpy.fft float64")  # the paper's: the bin nearest to the tone over bin 0
transform_gain = _charted("DTFT, matrix product float64")  # Fourier sum at the exact frequency over the mean
fitted_gain = _charted("fit, matrix product float64, D=1")  # least squares of mean and one tone


def gain_of_frame(x: float, scene: Scene, plain: Any, scale: float = 1.0, **options: Any) -> Point:
    """Gains of a frame of the scene by a plain method and by the library; ``options`` are those of ``tone_gain``."""
    frame = next(scene.frames(1))
    found = tone_gain(frame, scene.camera, scene.frequency, **options)
    return compared(x, scene.gain, plain(scene, frame), found, scale)


def peak_frequency(columns: npt.NDArray[Any]) -> Float64s:
    """Cycles per row of the highest bin other than the mean, for each column."""
    spectrum = np.abs(np.fft.rfft(columns.astype(np.float64), axis=0))
    return np.asarray((1 + spectrum[1:].argmax(axis=0)) / columns.shape[0])


def circular_inverse(columns: npt.NDArray[Any], camera: Camera, max_boost: float = 10.0) -> Float64s:
    """Division of the periodic DFT by H, with limited boost."""
    rows = columns.shape[0]
    response = exposure_response(np.fft.rfftfreq(rows, camera.row_period), camera.exposure or 0.0)
    restoring = response.conj() / np.maximum(np.abs(response) ** 2, max_boost**-2)
    return np.fft.irfft(np.fft.rfft(columns, axis=0) * restoring[:, None], rows, axis=0)
