"""Lamps without flicker: frequencies, duties and chip rates for given exposures."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np

from ocisac_fast import _core
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import InnerShare, ShareBelowOne, Within, checked, shown
from ocisac_fast.core.results import Result
from ocisac_fast.exposure.flicker import FlickeringLight, exposure_modulation, table_of

DIGITAL_SUM_SPANS = {"manchester": 2, "4b6b": 4, "8b10b": 6}  # largest - smallest running sum of chips as +-1
_HALVINGS = 60
_MOST_NULLS = 1000  # of one exposure in an interval that are tried


@dataclasses.dataclass(frozen=True, slots=True, repr=False)
class LampFrequencies(Result):
    """Result of :func:`flicker_free_frequencies`; Hz.

    Attributes:
        intervals: (intervals, 2) ascending, in which no exposure shows bands; else the best frequency twice, or the
            whole range if all are equally bad.
        best: (intervals,) the frequency with the least modulation in each.
        modulation: the largest modulation at the lowest of them.
        holds: True if such intervals exist.
        always_from: every frequency from here on satisfies the bound, outside the bounds too.
    """

    intervals: Float64s
    best: Float64s
    modulation: float
    holds: bool
    always_from: float


@checked
def flicker_free_frequencies(
    exposures: Sequence[float],
    below: InnerShare,
    bounds: tuple[float, float],
    *,
    duty: float | None = None,
    depth: float = 1.0,
    exposure_spread: ShareBelowOne = 0.0,
) -> LampFrequencies:
    """Frequencies of a lamp at which its modulation stays below a bound for all exposures, harmonics included.

    Args:
        exposures: of the cameras, s, above 0, at least one.
        below: bound of (max - min) / (max + min), above 0 and below 1.
        bounds: (lowest, highest) frequency in Hz, above 0.
        duty: of PWM, above 0 and below 1; the result also holds for larger ones. None: a raised cosine.
        depth: (max - min) / (max + min) of the lamp itself.
        exposure_spread: relative tolerance of each exposure, +-, 0 to below 1.
    """
    times = _checked_exposures(exposures)
    one_second = FlickeringLight(1.0, duty=duty, depth=depth)
    low, high = bounds
    if not 0.0 < low <= high < math.inf:
        raise ValueError(f"bounds: got {low} to {high}, allowed: 0 < lowest <= highest (Hz)")
    # f and T_e interchange
    shutters = table_of(dataclasses.replace(one_second, frequency=t, uncertainty=exposure_spread * t) for t in times)
    found = _core.flicker_free_intervals(shutters, below, (low, high))
    left = float(_core.exposure_modulation(shutters, found[0, 0]))
    holds = left <= below * (1.0 + 1e-12)  # rounding
    if not holds and list(found[0]) != [low, high]:
        found = np.repeat(found[:1, :1], 2, axis=1)
    # The maxima decrease as 1/(2n + 1) or faster.
    settled = _core.flicker_free_intervals(table_of([one_second]), below, (0.0, 1.0 / below + 2.0))[-1, 0]
    best = np.array([_best_within(interval, times, shutters) for interval in found])
    return LampFrequencies(found, best, left, holds, float(settled / ((1.0 - exposure_spread) * times.min())))


def _best_within(interval: Float64s, times: Float64s, shutters: Float64s) -> float:
    """The frequency of an interval with the least modulation: a null of one of the exposures, or an end."""
    low, high = interval
    nulls = [np.arange(np.ceil(time * low), min(time * high, _MOST_NULLS + time * low)) / time for time in times]
    tried = np.unique(np.clip(np.concatenate([interval, *nulls]), low, high))
    return float(tried[np.argmin(_core.exposure_modulation(shutters, tried))])


@checked
def smallest_flicker_free_duty(frequency: float, exposures: Sequence[float], below: InnerShare) -> float:
    """Smallest duty of PWM at which the modulation stays below a bound for all exposures; larger ones satisfy it too.

    Args:
        frequency: Hz, above 0.
        exposures: of the cameras, s, above 0, at least one.
        below: bound of (max - min) / (max + min), above 0 and below 1.

    Returns:
        Above 0 and below 1; 0 if every duty satisfies the bound.
    """
    times = _checked_exposures(exposures)

    def holds(duty: float) -> bool:
        return bool(np.max(exposure_modulation(FlickeringLight(frequency, duty=duty), times)) <= below)

    short, long = 0.0, 1.0
    if holds(2.0**-_HALVINGS):
        return 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (short + long)
        short, long = (short, middle) if holds(middle) else (middle, long)
        if long - short < 1e-15:
            break
    return long


@checked
def unmissed_frequency(exposures: Sequence[float], duty: InnerShare) -> float:
    """Lowest frequency in Hz of PWM at which every exposure contains light at any phase: T_e = (1 - duty) / f."""
    return (1.0 - duty) / float(_checked_exposures(exposures).min())


@checked
def flicker_free_chip_rate(
    exposures: Sequence[float], below: InnerShare, *, digital_sum_span: Annotated[float, Within(1.0)] = 2
) -> float:
    """Chip rate in Hz from which chips show no bands for any data, given the span of their running digital sum.

    Over x chips the digital sum changes by at most the span S. So the share of bright chips is within 1/2 +- S/(2x),
    and the modulation is at most S/x.

    Args:
        exposures: of the cameras, s, above 0, at least one.
        below: bound of (max - min) / (max + min), above 0 and below 1.
        digital_sum_span: of the line code, as in ``DIGITAL_SUM_SPANS``; 1 or above.
    """
    return digital_sum_span / below / float(_checked_exposures(exposures).min())


def _checked_exposures(exposures: Sequence[float]) -> Float64s:
    times = np.asarray(exposures, dtype=np.float64)
    if times.ndim != 1 or times.size == 0 or not np.all(np.isfinite(times) & (times > 0.0)):
        raise ValueError(f"exposures: got {shown(exposures)}, allowed: at least one, each finite and above 0 (s)")
    return times
