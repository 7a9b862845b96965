"""Trade-off of an exposure between communication and sensing."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import Positive, Within, checked
from ocisac_fast.core.results import Result

Points = Annotated[int, Within(2, 10_000_000)]


@dataclass(frozen=True, slots=True, repr=False)
class ExposureFront(Result):
    """Signals of communication and sensing over the exposure, shortest first.

    Attributes:
        exposure: T, s.
        comm, sense: T |sinc(f T)| / sqrt(1 + T / T_n) of the two, s; their weighted sum is the objective of
            :func:`best_noisy_exposure`, their squares are proportional to signal-to-noise ratios.
        efficient: True if no other exposure improves one without reducing the other.
    """

    exposure: Float64s
    comm: Float64s
    sense: Float64s
    efficient: npt.NDArray[np.bool_]


@checked
def exposure_front(
    f_comm: Positive,
    f_sense: Positive,
    *,
    bounds: tuple[float, float] | None = None,
    noise_exposure: float = math.inf,
    points: Points = 4001,
) -> ExposureFront:
    """Signals of communication and sensing over the exposure, with the efficient (Pareto-optimal) exposures.

    Args:
        f_comm, f_sense: Hz, finite, above 0.
        bounds: (shortest, longest) in s, 0 <= shortest < longest; None: up to 1/min(f_comm, f_sense).
        noise_exposure: T_n in s, above 0; infinite: noise does not depend on the exposure.
        points: 2 to 10 million, equally spaced.
    """
    low, high = (0.0, 1.0 / min(f_comm, f_sense)) if bounds is None else map(float, bounds)
    if not (0.0 <= low < high < math.inf):
        raise ValueError(f"bounds: got {low} to {high}, allowed: 0 <= shortest < longest (s)")
    if not noise_exposure > 0.0:
        raise ValueError(f"noise_exposure: got {noise_exposure}, allowed: a number above 0 (s), or infinity")
    exposure = np.linspace(low, high, points)
    with np.errstate(over="ignore"):  # noise without bound leaves no signal
        noise = np.sqrt(1.0 + exposure / noise_exposure)
    comm, sense = (exposure * np.abs(np.sinc(f * exposure)) / noise for f in (f_comm, f_sense))
    return ExposureFront(exposure, comm, sense, efficient_points(comm, sense))


def efficient_points(first: Float64s, second: Float64s) -> npt.NDArray[np.bool_]:
    """True for points that no other equals in one and exceeds in the other."""
    order = np.lexsort((-second, -first))  # descending by first, then by second
    best = np.maximum.accumulate(second[order])
    before = np.concatenate(([-math.inf], best[:-1]))
    efficient = np.zeros(first.size, np.bool_)
    efficient[order] = second[order] > before
    return efficient
