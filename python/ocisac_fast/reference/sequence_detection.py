"""Maximum-likelihood sequence detection of exposed chips over every state, in plain NumPy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def detect_sequence(
    rows: FloatArray, rows_per_chip: float, phase: float, exposure_rows: float, noise: float, first: int, count: int
) -> FloatArray:
    """The chips first ... first + count - 1 whose exposed light is nearest to the rows (least squares, Viterbi).

    A :data:`ocisac_fast.chips.channel.Detect`: rows are 0 for steady dark and 1 for steady bright, chip 0 begins at row
    ``phase``. A state is the chips before the newest that its rows still see: 2^ceil(exposure / rows_per_chip) of
    them. White noise: its size does not matter.
    """
    length = max(exposure_rows, 1e-3) / rows_per_chip
    memory = max(int(np.ceil(length)), 1)
    history = np.arange(2 << memory)  # bit j: chip - j
    bits = (history[:, None] >> np.arange(memory + 1)) & 1
    ends = (np.arange(len(rows)) + exposure_rows / 2 - phase) / rows_per_chip - first
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


def chip_llr(
    rows: npt.ArrayLike,
    *,
    rows_per_chip: float,
    phase: float,
    exposure_rows: float,
    noise: float,
    first: int,
    count: int,
) -> FloatArray:
    """By trying: the least squares of all sequences with a chip bright, and with it dark. For at most 16 chips."""
    if count > 16:
        raise ValueError(f"count: got {count}, allowed: at most 16")
    if count == 0:
        return np.zeros(0)
    values = np.asarray(rows, dtype=float)
    sequences = (np.arange(1 << count)[:, None] >> np.arange(count)) & 1
    length = max(exposure_rows, 1e-3) / rows_per_chip
    ends = (np.arange(len(values)) + exposure_rows / 2 - phase) / rows_per_chip - first
    chip = np.arange(count)
    overlap = np.minimum(ends[:, None], chip + 1) - np.maximum(ends[:, None] - length, chip)
    expected = sequences @ np.maximum(overlap, 0).T / length
    cost = np.sum((values - expected) ** 2, axis=1) / (2 * noise**2)
    least = [np.where(sequences == bit, cost[:, None], np.inf).min(axis=0) for bit in (0, 1)]
    return np.asarray(least[0] - least[1])


def closest_pair_distance(rows_per_chip: float, exposure_rows: float) -> float:
    """Square root of the least sum, over 16 places of the chips to the rows, of the squared differences of the rows."""
    length = exposure_rows / rows_per_chip

    def area(ends: FloatArray) -> FloatArray:
        return np.asarray(np.clip(ends, 0, 1) - np.clip(ends - 1, 0, 1))

    squares = []
    for place in np.arange(16) / 16:
        ends = np.arange(place, rows_per_chip * (length + 2)) / rows_per_chip
        squares.append(np.sum(((area(ends) - area(ends - length)) / length) ** 2))
    return float(np.sqrt(min(squares)))
