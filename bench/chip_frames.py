"""Frames of random chips seen through an exposure, with all that a detector needs to know."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast.chips import ChipClock, chip_llr, expose_chips
from ocisac_fast.core.arrays import Float64s

ROWS = 1080


@dataclass(frozen=True)
class ChipFrame:
    """One frame of random chips with random rate and phase, and all parameters that a detector needs."""

    chips: Float64s
    first: int
    clock: ChipClock
    noise: float
    rows: Float64s

    def detect(self, method: str) -> Float64s:
        """Log-likelihood ratios."""
        return chip_llr(self.rows, self.clock, noise=self.noise, first=self.first, count=self.chips.size, method=method)

    @property
    def whole(self) -> npt.NDArray[np.bool_]:
        """True for chips that the frame shows completely, not cut by its ends."""
        period, reach = self.clock.rows_per_chip, self.clock.exposure_rows / 2
        begin = self.clock.phase + (self.first + np.arange(self.chips.size)) * period
        return np.asarray((begin - reach > 0) & (begin + period + reach < self.rows.size - 1))

    def errors(self, llr: Float64s) -> tuple[int, int]:
        """Number of wrong chips, and number of chips."""
        whole = self.whole
        return int(np.sum((llr > 0)[whole] != self.chips[whole])), int(np.sum(whole))


def make_frame(exposure_chips: float, rows_per_chip: float, noise: float, random: np.random.Generator) -> ChipFrame:
    """Random chips, a rate within 1 % of the nominal one and a random phase; noise of a row over the swing."""
    period = rows_per_chip * (1 + random.uniform(-0.01, 0.01))
    first = -math.ceil(exposure_chips / 2) - 1
    chips = random.integers(0, 2, math.ceil(ROWS / period) - 2 * first).astype(float)
    clock = ChipClock(rows_per_chip=period, phase=random.uniform(0, period), exposure_rows=exposure_chips * period)
    light = expose_chips(chips, ROWS, clock, first=first)
    return ChipFrame(chips, first, clock, noise, light + noise * random.standard_normal(ROWS))
