"""Other methods for the gain of one tone in every column, each as fast as its library allows a careful user.

A peer is made for a number of rows, columns and a bin, and is called with frames of bytes (rows, columns); it returns
one gain per column. The tone is on a bin of the DFT, where all methods must agree.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Estimator = Callable[[np.ndarray], np.ndarray]


def _from_line(line: np.ndarray, mean: np.ndarray) -> np.ndarray:
    return 2.0 * np.abs(line) / np.abs(mean)


def numpy_rfft(rows: int, columns: int, k: int) -> Estimator:
    """``numpy.fft.rfft`` in float64 of the transposed frame, which is faster than along axis 0."""
    transpose = _transpose()

    def estimate(frame: np.ndarray) -> np.ndarray:
        spectrum = np.fft.rfft(transpose(frame), axis=1)
        return _from_line(spectrum[:, k], spectrum[:, 0])

    return estimate


def scipy_rfft(rows: int, columns: int, k: int) -> Estimator:
    """``scipy.fft.rfft`` in float32 of the transposed frame, one worker."""
    from scipy import fft

    transpose = _transpose()

    def estimate(frame: np.ndarray) -> np.ndarray:
        spectrum = fft.rfft(transpose(frame).astype(np.float32), axis=1, overwrite_x=True)
        return _from_line(spectrum[:, k], spectrum[:, 0])

    return estimate


def cv2_dft(rows: int, columns: int, k: int) -> Estimator:
    """Transposed bytes, float32, ``cv2.dft`` with ``DFT_ROWS``: one plan for all columns, CCS-packed result."""
    import cv2

    cv2.setNumThreads(1)

    def estimate(frame: np.ndarray) -> np.ndarray:
        packed = cv2.dft(cv2.transpose(frame).astype(np.float32), flags=cv2.DFT_ROWS)
        return _from_line(packed[:, 2 * k - 1] + 1j * packed[:, 2 * k], packed[:, 0])

    return estimate


def fftw(rows: int, columns: int, k: int) -> Estimator:
    """pyFFTW in float32: one measured plan over the transposed frame, reused buffers, one thread."""
    import pyfftw

    transpose = _transpose()
    light = pyfftw.empty_aligned((columns, rows), "float32")
    spectrum = pyfftw.empty_aligned((columns, rows // 2 + 1), "complex64")
    plan = pyfftw.FFTW(light, spectrum, axes=(1,), flags=("FFTW_MEASURE",), threads=1)

    def estimate(frame: np.ndarray) -> np.ndarray:
        light[...] = transpose(frame)
        plan()
        return _from_line(spectrum[:, k], spectrum[:, 0])

    return estimate


def matrix_product(rows: int, columns: int, k: int) -> Estimator:
    """Three row weights times the frame in float32 (BLAS, one thread), converted into a reused buffer."""
    angles = 2.0 * np.pi * (np.arange(rows) * k % rows) / rows
    weights = np.stack([np.ones(rows), 2.0 * np.cos(angles), 2.0 * np.sin(angles)]).astype(np.float32)
    light = np.empty((rows, columns), np.float32)

    def estimate(frame: np.ndarray) -> np.ndarray:
        light[...] = frame
        mean, cosine, sine = weights @ light
        return np.hypot(cosine, sine) / mean

    return estimate


def numba_goertzel(rows: int, columns: int, k: int) -> Estimator:
    """Goertzel's recurrence compiled by numba, float32, 64 columns side by side for SIMD."""
    import numba

    width = 64

    def strip(frame: np.ndarray, first: int, turn: Any, power: np.ndarray, sums: np.ndarray) -> None:
        one = np.zeros(width, np.float32)
        two = np.zeros(width, np.float32)
        total = np.zeros(width, np.float32)
        count = min(width, frame.shape[1] - first)
        for n in range(frame.shape[0]):
            row = frame[n, first : first + count]
            for c in range(count):
                value = np.float32(row[c])
                new = value + turn * one[c] - two[c]
                two[c] = one[c]
                one[c] = new
                total[c] += value
        for c in range(count):
            power[first + c] = one[c] * one[c] + two[c] * two[c] - turn * one[c] * two[c]
            sums[first + c] = total[c]

    compiled = numba.njit(fastmath=True)(strip)

    @numba.njit
    def run(frame: np.ndarray, turn: Any, power: np.ndarray, sums: np.ndarray) -> None:
        for first in range(0, frame.shape[1], width):
            compiled(frame, first, turn, power, sums)

    turn = np.float32(2.0 * np.cos(2.0 * np.pi * k / rows))

    def estimate(frame: np.ndarray) -> np.ndarray:
        power, sums = np.empty(columns, np.float32), np.empty(columns, np.float32)
        run(frame, turn, power, sums)
        return 2.0 * np.sqrt(np.maximum(power, 0.0)) / sums

    return estimate


def _transpose() -> Callable[[np.ndarray], np.ndarray]:
    """OpenCV's transpose if it is installed: several times faster than NumPy's copy."""
    try:
        import cv2
    except ModuleNotFoundError:
        return lambda frame: np.ascontiguousarray(frame.T)
    return cv2.transpose


PEERS: dict[str, tuple[str, Callable[[int, int, int], Estimator]]] = {
    "numpy.fft.rfft": ("numpy", numpy_rfft),
    "scipy.fft.rfft float32": ("scipy", scipy_rfft),
    "cv2.dft batched float32": ("cv2", cv2_dft),
    "pyFFTW float32": ("pyfftw", fftw),
    "matrix product float32": ("numpy", matrix_product),
    "numba Goertzel float32": ("numba", numba_goertzel),
}
