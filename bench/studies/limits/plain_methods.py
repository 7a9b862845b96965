"""Plain methods in addition to those of the chart (``studies.chart.methods``), in their simplest form."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.light.response import exposure_response
from studies.chart.methods import GAIN_METHODS
from studies.chart.scenes import Float64s, Scene, design_matrix

_CHARTED = {method.name: method for method in GAIN_METHODS}


def charted_gain(name: str, scene: Scene, columns: npt.NDArray[Any]) -> Float64s:
    """(columns,) gains by a method of the chart."""
    return np.asarray(_CHARTED[name].prepare(scene)(columns), dtype=np.float64)


def rounded_bin_gain(scene: Scene, columns: npt.NDArray[Any]) -> Float64s:
    """The paper's method: DFT, the bin nearest to the tone over bin 0 (eqs. 24-25)."""
    return charted_gain("rounded bin, numpy.fft float64", scene, columns)


def transform_gain(scene: Scene, columns: npt.NDArray[Any]) -> Float64s:
    """Fourier sum at the exact frequency over the mean."""
    return charted_gain("DTFT, matrix product float64", scene, columns)


def fitted_gain(scene: Scene, columns: npt.NDArray[Any]) -> Float64s:
    """Least squares of mean and one tone at the exact frequency."""
    return charted_gain("fit, matrix product float64, D=1", scene, columns)


def goertzel_float32_gain(scene: Scene, columns: npt.NDArray[Any]) -> Float64s:
    """Goertzel's recurrence in float32."""
    return charted_gain("Goertzel, numpy float32", scene, columns)


def float32_sums_gain(scene: Scene, columns: npt.NDArray[Any]) -> Float64s:
    """Fourier sum at the exact frequency without the mean, every sum along the rows in float32."""
    waves = design_matrix(scene.rows, scene.cycles_per_row, [1]).astype(np.float32)
    light = columns.astype(np.float32)
    sums = [np.add.reduce(wave[:, None] * light, axis=0) for wave in waves.T]  # row after row
    return np.asarray(2.0 * np.hypot(sums[1], sums[2]) / sums[0] / scene.ratio, dtype=np.float64)


def padded_bin_gain(scene: Scene, columns: npt.NDArray[Any], length: int) -> Float64s:
    """DFT zero-padded to a fast length, the bin nearest to the tone."""
    light = columns.astype(np.float64)
    mean = light.mean(axis=0)
    line = np.fft.rfft(light - mean, length, axis=0)[max(1, round(scene.cycles_per_row * length))]
    return np.asarray(2.0 / scene.rows * np.abs(line) / mean / scene.ratio)


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
