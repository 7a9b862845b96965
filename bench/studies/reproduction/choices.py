"""Exposure times by search, by the paper's closed form and by exact maximisation (figures 12 and 13)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.arrays import Float64s
from ocisac_fast.exposure.choice import best_exposure

PRINTED_MEAN, PRINTED_LARGEST = 0.0571, 0.3662  # the paper's deviations of its closed form
SLOWEST = 100.0  # Hz, f_min of figure 13


def signed_objective(exposure: npt.ArrayLike, *frequencies: float) -> Float64s:
    """Eq. 18 as printed, without magnitudes."""
    time = np.asarray(exposure, dtype=np.float64)
    return np.asarray(sum(np.sin(np.pi * f * time) / (np.pi * f) for f in frequencies))


@dataclass(frozen=True)
class Deviations:
    """Relative loss of the closed form against the exact optimum, over 100 ratios of frequencies."""

    inverse_ratio: Float64s  # 1/epsilon = f_min/f_max, 0.01 ... 1
    exact: Float64s  # objective, s
    closed_form: Float64s

    @property
    def loss(self) -> Float64s:
        """(100,) relative loss of the closed form."""
        return 1.0 - self.closed_form / self.exact


def deviations() -> Deviations:
    """Figure 13: f_min = 100 Hz, T in (0, 1/f_min]."""
    inverse_ratio = np.arange(1, 101) / 100.0
    fast = SLOWEST / inverse_ratio
    exact = best_exposure(fast, SLOWEST)
    closed = best_exposure(fast, SLOWEST, method="closed-form")
    return Deviations(inverse_ratio, np.asarray(exact.objective), np.asarray(closed.objective))
