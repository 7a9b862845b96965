"""Gain methods of the chart: those of a competent user, and this library's.

A method is prepared for a scene once (weights, windows, plans) and then called with frames of bytes (rows, columns); it
returns one gain per column. ``GAIN_METHODS`` is the list; others may append to it.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.tones.gain import tone_gain
from studies.chart.scenes import Bytes, Scene, design_matrix, least_squares, odd_harmonics

Values = npt.NDArray[Any]
FloatType = type[np.float32] | type[np.float64]
Estimator = Callable[[Bytes], Any]  # (columns,) gains


@dataclass(frozen=True)
class GainMethod:
    """One method from a frame to gains."""

    name: str  # unique
    family: str  # its methods share a marker in the chart
    precision: Literal["float32", "float64", "integer"]
    prepare: Callable[[Scene], Estimator]  # makes the estimator for a scene
    series: str = ""  # methods of one series are joined by a line, in the order of row_group; empty: none
    row_group: int = 1  # D, rows added before the multiplication
    timed_per_scene: bool = False  # False if the time is independent of the frequency
    needs: str = ""  # library that must be installed
    label: str = ""  # text at the point in the chart

    @property
    def installed(self) -> bool:
        """True if its library is installed."""
        return not self.needs or importlib.util.find_spec(self.needs) is not None


GAIN_METHODS: list[GainMethod] = []


# Spectra: (rows, columns) light, zero-padded to a length -> (bins, columns), the requested bins of the whole spectrum.


def _numpy_spectrum(light: Values, length: int, bins: list[int]) -> Values:
    return np.fft.rfft(light, length, axis=0)[bins]


def _scipy_spectrum(light: Values, length: int, bins: list[int]) -> Values:
    spectrum: Values = importlib.import_module("scipy.fft").rfft(light, length, axis=0)
    return spectrum[bins]


def _cv2_spectrum(light: Values, length: int, bins: list[int]) -> Values:
    """Transposed and batched, so that one plan serves all columns; bins 1 ... of the CCS-packed result, or bin 0."""
    cv2 = importlib.import_module("cv2")
    lying = cv2.copyMakeBorder(cv2.transpose(light), 0, 0, 0, length - light.shape[0], cv2.BORDER_CONSTANT, value=0)
    packed = cv2.dft(lying, flags=cv2.DFT_ROWS)
    return np.stack([packed[:, 2 * k - 1] + 1j * packed[:, 2 * k] if k else packed[:, 0] + 0j for k in bins])


@dataclass(frozen=True)
class _Transform:
    name: str
    spectrum: Callable[[Values, int, list[int]], Values]
    dtype: FloatType
    needs: str = ""

    @property
    def precision(self) -> Literal["float32", "float64"]:
        return "float32" if self.dtype is np.float32 else "float64"


_NUMPY = _Transform("numpy.fft float64", _numpy_spectrum, np.float64)
_SCIPY = _Transform("scipy.fft float32", _scipy_spectrum, np.float32, "scipy")
_CV2 = _Transform("cv2.dft float32", _cv2_spectrum, np.float32, "cv2")


def rounded_bin(transform: _Transform) -> Callable[[Scene], Estimator]:
    """The paper's method (eqs. 24-25): the whole spectrum, then the bin nearest to the tone over bin 0."""

    def prepare(scene: Scene) -> Estimator:
        k = max(1, round(scene.cycles))

        def estimate(frame: Bytes) -> Any:
            mean, line = np.abs(transform.spectrum(frame.astype(transform.dtype), scene.rows, [0, k]))
            return 2.0 * line / mean / scene.ratio

        return estimate

    return prepare


_HANN = (0.5, 0.5)
_FLAT_TOP = (0.21557895, 0.41663158, 0.277263158, 0.083578947, 0.006947368)  # ISO 18431-2


def _cosine_window(terms: tuple[float, ...], rows: int) -> Float64s:
    k = np.arange(rows)[:, None] * np.arange(len(terms))
    return np.asarray(np.cos(2.0 * np.pi * k / rows) @ (np.array(terms) * (-1.0) ** np.arange(len(terms))))


def windowed_bin(transform: _Transform, terms: tuple[float, ...]) -> Callable[[Scene], Estimator]:
    """Subtract the mean, apply a window, and divide the bin nearest to the tone by the window's sum."""

    def prepare(scene: Scene) -> Estimator:
        window: Values = _cosine_window(terms, scene.rows).astype(transform.dtype)[:, None]
        k = max(1, round(scene.cycles))
        scale = 2.0 / float(window.sum()) / scene.ratio

        def estimate(frame: Bytes) -> Any:
            light: Values = frame.astype(transform.dtype)
            mean = light.mean(axis=0)
            line = transform.spectrum((light - mean) * window, scene.rows, [k])[0]
            return scale * np.abs(line) / mean

        return estimate

    return prepare


def zero_padded(transform: _Transform, times: int = 4) -> Callable[[Scene], Estimator]:
    """Subtract the mean, zero-pad to ``times`` the length, and use the nearest bin."""

    def prepare(scene: Scene) -> Estimator:
        length = times * scene.rows
        k = max(1, round(times * scene.cycles))

        def estimate(frame: Bytes) -> Any:
            light: Values = frame.astype(transform.dtype)
            mean = light.mean(axis=0)
            line = transform.spectrum(light - mean, length, [k])[0]
            return 2.0 / scene.rows * np.abs(line) / mean / scene.ratio

        return estimate

    return prepare


def interpolated(transform: _Transform) -> Callable[[Scene], Estimator]:
    """Hann window; frequency and amplitude from the ratio of the two largest bins (Grandke 1983)."""

    def prepare(scene: Scene) -> Estimator:
        window: Values = _cosine_window(_HANN, scene.rows).astype(transform.dtype)[:, None]
        k = max(2, round(scene.cycles))
        side = k + 1 if scene.cycles >= k else k - 1

        def estimate(frame: Bytes) -> Any:
            light: Values = frame.astype(transform.dtype)
            mean = light.mean(axis=0)
            peak, next_to_it = np.abs(transform.spectrum((light - mean) * window, scene.rows, [k, side]))
            ratio = next_to_it / peak
            offset = (2.0 * ratio - 1.0) / (ratio + 1.0)
            amplitude = 4.0 / scene.rows * peak * (1.0 - offset**2) / np.sinc(offset)
            return amplitude / mean / scene.ratio

        return estimate

    return prepare


def _gain_of_sums(sums: Values, ratio: float) -> Any:
    """Gain from mean, cosine and sine, (3, columns)."""
    return np.hypot(sums[1], sums[2]) / sums[0] / ratio


def _transform_weights(cycles_per_row: float, rows: int) -> Float64s:
    """(3, rows): mean, and the Fourier sum at one frequency, exact or on a bin."""
    waves = design_matrix(rows, cycles_per_row, [1]).T
    return np.asarray(waves * np.array([1.0, 2.0, 2.0])[:, None] / rows)


def _fit_weights(scene: Scene, row_group: int, harmonics: bool) -> Float64s:
    """(3, groups) rows of the pseudo-inverse of a model whose rows are added in groups like those of the frame."""
    groups = scene.rows // row_group
    orders = odd_harmonics(scene.cycles_per_row, scene.rows, row_group) if harmonics else [1]
    design = design_matrix(groups * row_group, scene.cycles_per_row, orders)
    return least_squares(design.reshape(groups, row_group, -1).sum(axis=1))[:3]


Weights = Callable[[Scene], Float64s]


def by_matrix_product(weights: Weights, row_group: int, dtype: FloatType) -> Callable[[Scene], Estimator]:
    """NumPy: add rows in groups, convert, one matrix product."""

    def prepare(scene: Scene) -> Estimator:
        matrix: Values = weights(scene).astype(dtype)

        def estimate(frame: Bytes) -> Any:
            if row_group > 1:
                whole = frame[: matrix.shape[1] * row_group].reshape(-1, row_group, frame.shape[1])
                return _gain_of_sums(matrix @ whole.sum(axis=1, dtype=np.uint16).astype(dtype), scene.ratio)
            return _gain_of_sums(matrix @ frame.astype(dtype), scene.ratio)

        return estimate

    return prepare


def by_kernel(weights: Weights, row_group: int, limbs: int) -> Callable[[Scene], Estimator]:
    """This library's streaming product, with weights in ``limbs`` parts of 13 bits."""

    def prepare(scene: Scene) -> Estimator:
        plan = _core.RowWeights(weights(scene), scene.rows, row_group, limbs)

        def estimate(frame: Bytes) -> Any:
            return _gain_of_sums(_core.project(frame, plan)[0], scene.ratio)

        return estimate

    return prepare


def goertzel(dtype: FloatType) -> Callable[[Scene], Estimator]:
    """s_n = x_n + 2 cos(2 pi f T_r) s_(n-1) - s_(n-2) along the rows of all columns at once."""

    def prepare(scene: Scene) -> Estimator:
        turn = dtype(2.0 * np.cos(2.0 * np.pi * scene.cycles_per_row))

        def estimate(frame: Bytes) -> Any:
            state: Values = np.zeros((3, frame.shape[1]), dtype)
            one, two, new = state
            for row in frame:
                np.multiply(one, turn, out=new)
                new -= two
                new += row
                one, two, new = new, one, two
            power = one * one + two * two - turn * one * two
            mean = frame.mean(axis=0, dtype=dtype)
            return 2.0 / scene.rows * np.sqrt(np.maximum(power, 0)) / mean / scene.ratio

        return estimate

    return prepare


def by_library(efficiency: float, harmonics: bool) -> Callable[[Scene], Estimator]:
    """``ocisac_fast.tone_gain``, with its standard errors and flags."""

    def prepare(scene: Scene) -> Estimator:
        camera = scene.camera
        waveform: Literal["tone", "square"] = "square" if harmonics else "tone"
        correction = (4.0 / np.pi if harmonics else 1.0) / scene.ratio

        def estimate(frame: Bytes) -> Any:
            found = tone_gain(frame, camera, scene.frequency, waveform=waveform, efficiency=efficiency)
            return found.gain * correction

        return estimate

    return prepare


def _add(name: str, family: str, precision: Any, prepare: Callable[[Scene], Estimator], **about: Any) -> None:
    GAIN_METHODS.append(GainMethod(name, family, precision, prepare, **about))


def _exact(scene: Scene) -> Float64s:
    return _transform_weights(scene.cycles_per_row, scene.rows)


def _on_bin(scene: Scene) -> Float64s:
    return _transform_weights(max(1, round(scene.cycles)) / scene.rows, scene.rows)


def _register() -> None:
    for one in (_NUMPY, _SCIPY, _CV2):
        _add(f"rounded bin, {one.name}", "rounded bin (paper)", one.precision, rounded_bin(one), needs=one.needs)
    for one in (_NUMPY, _SCIPY):
        for name, family, prepare in (
            ("Hann", "windowed DFT: Hann", windowed_bin(one, _HANN)),
            ("flat-top", "windowed DFT: flat-top", windowed_bin(one, _FLAT_TOP)),
            ("zero-padded x4", "zero-padded DFT", zero_padded(one)),
            ("interpolated", "interpolated DFT", interpolated(one)),
        ):
            _add(f"{name}, {one.name}", family, one.precision, prepare, needs=one.needs)
    for dtype in (np.float32, np.float64):
        precision = np.dtype(dtype).name
        _add(f"Goertzel, numpy {precision}", "Goertzel", precision, goertzel(dtype))
        _add(f"DTFT, matrix product {precision}", "DTFT", precision, by_matrix_product(_exact, 1, dtype))
    _add("DTFT, kernel", "DTFT", "integer", by_kernel(_exact, 1, 2))
    _add("rounded bin, kernel", "rounded bin (paper)", "integer", by_kernel(_on_bin, 1, 2))
    for harmonics, kind in ((False, "fit"), (True, "fit with harmonics")):
        for group in (1, 2, 4, 8):
            weights = functools.partial(_fit_weights, row_group=group, harmonics=harmonics)
            products = [(np.dtype(d).name, by_matrix_product(weights, group, d)) for d in (np.float32, np.float64)]
            ways = [(f"matrix product {name}", name, prepare) for name, prepare in products]
            ways += [(f"kernel {13 * limbs} bits", "integer", by_kernel(weights, group, limbs)) for limbs in (1, 2)]
            for way, precision, prepare in ways:
                series = f"{kind}, {way}"
                _add(f"{series}, D={group}", kind, precision, prepare, series=series, row_group=group)
        for efficiency in (1.0, 0.99):
            label = "tone_gain" if harmonics and efficiency < 1.0 else ""
            about: dict[str, Any] = {"series": f"{kind}, tone_gain", "timed_per_scene": True, "label": label}
            name = f"{kind}, tone_gain(efficiency={efficiency:g})"
            _add(name, kind, "integer", by_library(efficiency, harmonics), **about)


_register()
