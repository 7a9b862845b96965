"""Maximum-likelihood sequence detection of exposed chips over every state, in plain NumPy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def detect_sequence(
    rows: FloatArray, rows_per_chip: float, phase: float, exposure: float, noise: float, first: int, count: int
) -> FloatArray:
    """The chips first ... first + count - 1 whose exposed light is nearest to the rows (least squares, Viterbi).

    A :data:`ocisac_fast.channel.Detect`: rows are 0 for steady dark and 1 for steady bright, chip 0 begins at row
    ``phase``. A state is the chips before the newest that its rows still see: 2^ceil(exposure / rows_per_chip) of
    them. White noise: its size does not matter.
    """
    length = max(exposure, 1e-3) / rows_per_chip
    memory = max(int(np.ceil(length)), 1)
    history = np.arange(2 << memory)  # bit j: chip - j
    bits = (history[:, None] >> np.arange(memory + 1)) & 1
    ends = (np.arange(len(rows)) + exposure / 2 - phase) / rows_per_chip - first
    newest = np.floor(ends).astype(int)
    cost = np.zeros(1 << memory)
    origin = np.zeros((count, 1 << memory), dtype=np.int64)
    for chip in range(count):
        seen = newest == chip
        end = ends[seen] - chip
        back = np.arange(memory + 1)
        overlap = np.minimum(end[:, None], 1 - back) - np.maximum(end[:, None] - length, -back)
        expected = bits @ np.maximum(overlap, 0).T / length
        paths = cost[history >> 1] + np.sum((rows[seen] - expected) ** 2, axis=1)
        low, high = paths[: 1 << memory], paths[1 << memory :]  # the chip that leaves: 0, 1
        origin[chip] = np.where(high < low, history[1 << memory :], history[: 1 << memory]) >> 1
        cost = np.minimum(low, high)
    state = int(np.argmin(cost))
    chips = np.zeros(count)
    for chip in reversed(range(count)):
        chips[chip] = state & 1
        state = int(origin[chip, state])
    return chips
