"""Shares of blocks for every pixel, and stored values under a tone curve with a toe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocisac_fast.core.arrays import Float64s


@dataclass(frozen=True, slots=True, eq=False)
class BlockShares:
    """Shares (rows, columns) of blocks of pixels, ``rows`` by ``columns`` large."""

    share: Float64s
    rows: int = 1
    columns: int = 1

    def enlarged(self, shape: tuple[int, int]) -> Float64s:
        """The share of each pixel, interpolated between the centres of the blocks."""
        values = self.share
        for axis, block in enumerate((self.rows, self.columns)):
            if block == 1:
                continue
            last = values.shape[axis] - 1
            at = np.clip((np.arange(shape[axis]) + 0.5) / block - 0.5, 0.0, last)
            before = at.astype(int)
            weight = np.expand_dims(at - before, 1 - axis)
            one, two = values.take(before, axis), values.take(np.minimum(before + 1, last), axis)
            values = one + weight * (two - one)
        return values


def lowered(light: Float64s, toe: float, white: float) -> Float64s:
    """Stored values x^2/(x + t W) of light x, toe t and white light W; odd symmetry below dark."""
    if toe == 0.0:
        return light
    return np.asarray(light * np.abs(light) / (np.abs(light) + toe * white))
