"""Other methods for the gain of one tone in every column, each as fast as its library allows a careful user.

A peer is made for a number of rows, columns and a bin, and is called with frames of bytes (rows, columns); it returns
one gain per column. The tone is on a bin of the DFT, where all methods must agree.
"""

from __future__ import annotations

from collections.abc import Callable

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
}
