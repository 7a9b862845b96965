"""Exposure integration as a careful user writes it with NumPy, for bench/speed.py."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ocisac_fast import Camera

CHIP_LEVELS = np.random.default_rng(2).integers(0, 2, 1000).astype(float)


class ClosedForms:
    """Mean light of each row of each frame in float64, in memory that is kept.

    NumPy gives the memory of large results back, and whether it is cheap to get again depends on what ran before: a
    frame of square waves took 25 or 45 ms.
    """

    def __init__(self, shape: tuple[int, int], camera: Camera) -> None:
        """``shape``: (frames, rows); ``camera`` with exposure and frame time."""
        assert camera.exposure is not None
        assert camera.frame_time is not None
        self._exposure = camera.exposure
        frames, rows = shape
        self._rows = np.arange(rows) * camera.row_time
        self._starts = np.arange(frames)[:, None] * camera.frame_time
        self._times, self._part, self._end, self._begin = (np.empty(shape) for _ in range(4))
        self._index, self._turns = (np.empty(shape, np.int64) for _ in range(2))
        self._sums = np.concatenate([[0.0], np.cumsum(CHIP_LEVELS)])

    def tone(self, out: np.ndarray) -> None:
        """1/2 + 1/2 cos(w t), w = 2 pi 500, into ``out`` (frames, rows), as all of these."""
        w = 2.0 * np.pi * 500.0

        def swing(times: np.ndarray, to: np.ndarray) -> None:
            np.multiply(times, w, out=to)
            np.sin(to, out=to)

        self._means(swing, 0.5 / w, 0.5, out)

    def square(self, out: np.ndarray) -> None:
        """500 Hz, duty 1/2, bright about t = 0."""

        def bright(times: np.ndarray, to: np.ndarray) -> None:
            np.multiply(times, 500.0, out=self._part)
            np.add(self._part, 0.25, out=self._part)
            np.floor(self._part, out=to)
            np.subtract(self._part, to, out=self._part)
            np.minimum(self._part, 0.5, out=self._part)
            np.multiply(to, 0.5, out=to)
            np.add(to, self._part, out=to)

        self._means(bright, 1 / 500.0, 0.0, out)

    def chips(self, out: np.ndarray) -> None:
        """``CHIP_LEVELS`` at 8 kHz, repeated: sums of whole chips and a share of the last."""

        def light(times: np.ndarray, to: np.ndarray) -> None:
            np.multiply(times, 8e3, out=self._part)
            np.floor(self._part, out=to)
            np.subtract(self._part, to, out=self._part)
            np.copyto(self._index, to, casting="unsafe")
            np.divmod(self._index, CHIP_LEVELS.size, out=(self._turns, self._index))
            np.take(CHIP_LEVELS, self._index, out=to, mode="clip")
            np.multiply(self._part, to, out=self._part)
            np.take(self._sums, self._index, out=to, mode="clip")
            np.add(to, self._part, out=to)
            np.multiply(self._turns, self._sums[-1], out=self._part)
            np.add(to, self._part, out=to)

        self._means(light, 1 / 8e3, 0.0, out)

    def _means(
        self, light: Callable[[np.ndarray, np.ndarray], None], scale: float, steady: float, out: np.ndarray
    ) -> None:
        """steady + scale (light(t) - light(t - T_e)) / T_e."""
        np.add(self._starts, self._rows, out=self._times)
        light(self._times, self._end)
        np.subtract(self._times, self._exposure, out=self._times)
        light(self._times, self._begin)
        np.subtract(self._end, self._begin, out=self._end)
        np.multiply(self._end, scale / self._exposure, out=out)
        np.add(out, steady, out=out)
