"""Exposures at which flickering lights leave no bands: modulation over all phases, and intervals where it is bounded.

With x = f T_e cycles in an exposure, a light's modulation is (max - min) / (max + min) of the mean light over the
exposure, over all phases: |sinc(x)| for a raised cosine of full depth. It is 0 at whole x and has one maximum between
neighbouring whole x. These maxima decrease with x for tones and for PWM of any duty. So the exposures below a bound
are intervals about the nulls, found by bisection of monotone pieces.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import InnerShare, Positive, ShareAboveZero, checked, checked_class
from ocisac_fast.core.results import Result
from ocisac_fast.exposure.fronts import Points, efficient_points

LONGEST_EXPOSURE = 0.1  # s, upper default bound
MAINS_DRIFT = 0.01  # share; EN 50160: 50 Hz +- 1 % during 99.5 % of a year
_MOST_NULLS = 1_000_000  # of a light


@checked_class
@dataclass(frozen=True, slots=True)
class FlickeringLight:
    """A periodic light of any phase.

    Args:
        frequency: Hz, above 0.
        uncertainty: half width of the interval that contains the frequency, Hz, 0 to below ``frequency``.
        duty: bright share of a PWM period, above 0 and below 1 (0.5: a square wave); None: a raised cosine. The
            modulation decreases with the duty, so a bound for one duty holds for all larger ones.
        depth: (max - min) / (max + min) of the light itself, above 0, at most 1.
    """

    frequency: Positive
    _: KW_ONLY
    uncertainty: float = 0.0
    duty: InnerShare | None = None
    depth: ShareAboveZero = 1.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.uncertainty < self.frequency:
            raise ValueError(f"uncertainty: got {self.uncertainty}, allowed: 0 to below {self.frequency} (Hz)")


@checked
def mains_lights(
    frequencies: Sequence[float] = (50.0, 60.0), *, drift: float = MAINS_DRIFT
) -> tuple[FlickeringLight, ...]:
    """Mains lamps: raised cosines of twice the mains' frequency, full depth.

    Within ``drift`` of a null they also bound full-wave rectified sines, whose harmonics 2/(4n^2 - 1) add up to 1.

    Args:
        frequencies: of the mains, Hz.
        drift: relative half width of the interval that contains each frequency.
    """
    return tuple(FlickeringLight(2.0 * f, uncertainty=2.0 * f * drift) for f in frequencies)


@dataclass(frozen=True, slots=True, repr=False)
class FlickerFreeExposure(Result):
    """Result of :func:`flicker_free_exposure`.

    Attributes:
        exposure: s.
        modulation: the largest modulation of any light.
        holds: True if no modulation is above the bound and the data light keeps its gain.
        modulations: of each light.
        objective: Y(exposure) of eq. 18 in s; NaN if it was not maximised.
        gain: |sinc(f_comm exposure)|; NaN without a data light.
        null: exposure with less modulation, s, a whole number of a light's periods between which and ``exposure`` all
            satisfy the bound: a margin where ``exposure`` is at its edge. NaN: there is none.
    """

    exposure: float
    modulation: float
    holds: bool
    modulations: tuple[float, ...]
    objective: float = math.nan
    gain: float = math.nan
    null: float = math.nan


@checked
def exposure_modulation(light: FlickeringLight, exposure: npt.ArrayLike) -> Float64s:
    """Largest (max - min) / (max + min) over all phases and the light's frequencies, harmonics included.

    Args:
        light: the light.
        exposure: s, 0 or above, any shape.

    Returns:
        float64 of the shape of ``exposure``, 0 to 1.
    """
    return _core.exposure_modulation(table_of([light]), np.asarray(exposure, dtype=np.float64))


@checked
def flicker_free_exposure(
    lights: Sequence[FlickeringLight],
    below: float,
    *,
    near: float | None = None,
    bounds: tuple[float, float] | None = None,
    step: float | None = None,
    f_comm: float | None = None,
    f_sense: float | None = None,
    min_gain: float | None = None,
    weights: tuple[float, float] = (1, 1),
) -> FlickerFreeExposure:
    """Exposure at which no light's modulation exceeds a bound: the nearest, the shortest, or the maximum of eq. 18.

    Args:
        lights: at least one.
        below: bound of the modulation, above 0 and below 1.
        near: requested exposure, s, above 0; the nearest that satisfies the bound is returned. None: the shortest, or
            the one that maximises eq. 18 where ``f_sense``, or ``f_comm`` without ``min_gain``, is given.
        bounds: (shortest, longest) in s; None: above 0 and up to 0.1 s. An exposure of 0 is never chosen.
        step: restrict exposures to whole multiples of it (s), for example the row time.
        f_comm: frequency of a data light in Hz, above 0.
        f_sense: f_x v in Hz; a second frequency of eq. 18, needs ``f_comm``.
        min_gain: min. |sinc(f_comm T)| of the data light, above 0 and below 1; needs ``f_comm``.
        weights: of communication and sensing.

    Returns:
        :class:`FlickerFreeExposure`. If no exposure satisfies the bound: the smallest modulation among those that keep
            the data light's gain; if none keeps it, the smallest of all.

    Raises:
        ValueError: an argument outside its range, no multiple of ``step`` within the bounds, ``f_comm`` within the
            frequencies of ``lights``, or a bound that every exposure satisfies, so that none is the shortest.
    """
    domain = (0.0, LONGEST_EXPOSURE) if bounds is None else bounds
    found = FlickerFreeExposure(
        *_core.flicker_free_exposure(
            table_of(lights), below, near, domain, step, f_comm, f_sense, min_gain, (weights[0], weights[1])
        )
    )
    return dataclasses.replace(found, null=_null_beside(found, lights, below, domain)) if found.holds else found


_BETWEEN = 65  # exposures that are checked between an exposure and a null


def _null_beside(
    found: FlickerFreeExposure, lights: Sequence[FlickeringLight], below: float, bounds: tuple[float, float]
) -> float:
    nulls = [round(found.exposure * light.frequency) / light.frequency for light in lights]
    inside = [null for null in nulls if bounds[0] < null <= bounds[1]]
    between = np.linspace(found.exposure, inside, _BETWEEN)  # (exposures, nulls)
    modulation = _core.exposure_modulation(table_of(lights), between)
    better = (modulation.max(axis=0) <= below * (1.0 + 1e-9)) & (modulation[-1] < found.modulation * (1.0 - 1e-9))
    best = int(np.argmin(np.where(better, modulation[-1], np.inf))) if better.any() else None
    return math.nan if best is None else inside[best]


@dataclass(frozen=True, slots=True, repr=False)
class FlickerFront(Result):
    """Gain of a data light and modulation of other lights.

    Attributes:
        exposure: (points,) s.
        gain: (points,) |sinc(f_comm exposure)|.
        modulation: (points,) the largest modulation of any light.
        efficient: (points,) True if no other exposure has as much gain and less modulation.
    """

    exposure: Float64s
    gain: Float64s
    modulation: Float64s
    efficient: npt.NDArray[np.bool_]


@checked
def flicker_front(
    f_comm: Positive,
    lights: Sequence[FlickeringLight],
    *,
    bounds: tuple[float, float] | None = None,
    points: Points = 20001,
) -> FlickerFront:
    """Gain of the data light and modulation of other lights over exposures, and the efficient exposures.

    Args:
        f_comm: Hz, above 0.
        lights: at least one.
        bounds: (shortest, longest) in s; None: above 0 and up to 0.1 s.
        points: 2 to 10 million, equally spaced. The nulls of the lights within the bounds are added, at most a million
            of each.
    """
    if len(lights) == 0:
        raise ValueError("lights: got none, allowed: at least one")
    if any(abs(f_comm - light.frequency) <= light.uncertainty for light in lights):
        raise ValueError(f"f_comm: got {f_comm}, allowed: none of the lights to avoid")
    low, high = (0.0, LONGEST_EXPOSURE) if bounds is None else bounds
    if not (0.0 <= low <= high < math.inf and high > 0.0):
        raise ValueError(f"bounds: got {low} to {high}, allowed: 0 <= shortest <= longest, above 0 (s)")
    for light in lights:
        if light.frequency * high > _MOST_NULLS:
            got = f"{light.frequency * high:.6g} cycles of {light.frequency:g} Hz"
            raise ValueError(f"bounds: got {got}, allowed: at most a million")
    nulls = [np.arange(1.0, math.floor(light.frequency * high) + 1.0) / light.frequency for light in lights]
    exposure = np.unique(np.concatenate([np.linspace(low, high, points), *nulls]))
    exposure = exposure[(exposure > 0.0) & (exposure >= low) & (exposure <= high)]
    gain = np.abs(np.sinc(f_comm * exposure))
    modulation = _core.exposure_modulation(table_of(lights), exposure)
    return FlickerFront(exposure, gain, modulation, efficient_points(gain, -modulation))


def table_of(lights: Iterable[FlickeringLight]) -> Float64s:
    """(lights, 4) of frequency, uncertainty, duty (NaN: a raised cosine), depth."""
    rows = [(x.frequency, x.uncertainty, math.nan if x.duty is None else x.duty, x.depth) for x in lights]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)
