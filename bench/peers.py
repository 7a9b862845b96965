"""Other methods for the gain of one tone in every column, each as fast as its library allows a careful user.

A peer is called with a frame of bytes (rows, columns) and a bin of the DFT, on which the tone is and all methods must
agree; it returns one gain per column.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

Estimator = Callable[[np.ndarray], np.ndarray]


def numpy_rfft(frame: np.ndarray, k: int) -> np.ndarray:
    """``numpy.fft.rfft`` in float64 of the transposed frame, which is faster than along axis 0."""
    spectrum = np.fft.rfft(_transpose()(frame), axis=1)
    return _gain(spectrum[:, k], spectrum[:, 0])


def scipy_rfft(frame: np.ndarray, k: int) -> np.ndarray:
    """``scipy.fft.rfft`` in float32 of the transposed frame, one worker."""
    from scipy import fft

    spectrum = fft.rfft(_transpose()(frame).astype(np.float32), axis=1, overwrite_x=True)
    return _gain(spectrum[:, k], spectrum[:, 0])


def cv2_dft(frame: np.ndarray, k: int) -> np.ndarray:
    """Transposed bytes, float32, ``cv2.dft`` with ``DFT_ROWS``: one plan for all columns, CCS-packed result."""
    import cv2

    packed = cv2.dft(_transpose()(frame).astype(np.float32), flags=cv2.DFT_ROWS)
    return _gain(packed[:, 2 * k - 1] + 1j * packed[:, 2 * k], packed[:, 0])


def _gain(line: np.ndarray, mean: np.ndarray) -> np.ndarray:
    return 2.0 * np.abs(line) / np.abs(mean)


@functools.cache
def _transpose() -> Estimator:
    """OpenCV's transpose, in one thread, if it is installed: several times faster than NumPy's copy."""
    try:
        import cv2
    except ModuleNotFoundError:
        return lambda frame: np.ascontiguousarray(frame.T)
    cv2.setNumThreads(1)
    return cv2.transpose


PEERS: dict[str, tuple[str, Callable[[np.ndarray, int], np.ndarray]]] = {
    "numpy.fft.rfft": ("numpy", numpy_rfft),
    "scipy.fft.rfft float32": ("scipy", scipy_rfft),
    "cv2.dft batched float32": ("cv2", cv2_dft),
}
