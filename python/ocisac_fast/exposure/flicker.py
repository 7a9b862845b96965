"""Exposures at which flickering lights leave no bands: modulation over all phases, and intervals where it is bounded.

With x = f T_e cycles in an exposure, a light's modulation is (max - min) / (max + min) of the mean light over the
exposure, over all phases: |sinc(x)| for a raised cosine of full depth. It is 0 at whole x and has one maximum between
neighbouring whole x. These maxima decrease with x for tones and for PWM of any duty. So the exposures below a bound
are intervals about the nulls, found by bisection of monotone pieces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.checks import checked, checked_class
from ocisac_fast.exposure.choice import best_exposure, exposure_objective

Float64s = npt.NDArray[np.float64]

LONGEST_EXPOSURE = 0.1  # s, upper default bound
MAINS_DRIFT = 0.01  # share; EN 50160: 50 Hz +- 1 % during 99.5 % of a year
_MAX_VALUES = 10_000_000
_MAX_NULLS = 1_000_000
_HALVINGS = 60  # of a bracket: to float64 precision
_SHRINK = 2.0**-50  # relative reduction of intervals, which keeps their ends within the bound despite rounding


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

    Raises:
        ValueError: a value outside its range.
    """

    frequency: float
    _: KW_ONLY
    uncertainty: float = 0.0
    duty: float | None = None
    depth: float = 1.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.frequency) and self.frequency > 0.0):
            raise ValueError(f"frequency: got {self.frequency}, allowed: a finite number above 0 (Hz)")
        if not 0.0 <= self.uncertainty < self.frequency:
            raise ValueError(f"uncertainty: got {self.uncertainty}, allowed: 0 to below {self.frequency} (Hz)")
        if self.duty is not None and not 0.0 < self.duty < 1.0:
            raise ValueError(f"duty: got {self.duty}, allowed: above 0 and below 1, or None")
        if not 0.0 < self.depth <= 1.0:
            raise ValueError(f"depth: got {self.depth}, allowed: above 0, at most 1")


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


@dataclass(frozen=True, slots=True)
class FlickerFreeExposure:
    """Result of :func:`flicker_free_exposure`.

    Attributes:
        exposure: s.
        modulation: the largest modulation of any light.
        holds: True if no modulation is above the bound and the data light keeps its gain.
        modulations: of each light.
        objective: Y(exposure) of eq. 18 in s; NaN if it was not maximised.
        gain: |sinc(f_comm exposure)|; NaN without a data light.
    """

    exposure: float
    modulation: float
    holds: bool
    modulations: tuple[float, ...]
    objective: float = math.nan
    gain: float = math.nan


@checked
def exposure_modulation(light: FlickeringLight, exposure: npt.ArrayLike) -> Float64s:
    """Largest (max - min) / (max + min) over all phases and the light's frequencies, harmonics included.

    Args:
        light: the light.
        exposure: s, 0 or above, any shape.

    Returns:
        float64 of the shape of ``exposure``, 0 to 1.
    """
    times = np.asarray(exposure, dtype=np.float64)
    low, high = ((light.frequency + sign * light.uncertainty) * times for sign in (-1, 1))
    whole = np.floor(low)
    peak = _peak(light, whole)
    peak = np.where(peak < low, _peak(light, whole + 1.0), peak)
    inside = np.where(peak <= high, _modulation(light, peak), 0.0)
    return np.asarray(np.maximum(np.maximum(_modulation(light, low), _modulation(light, high)), inside))


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
    _check(lights, below, near, f_comm, f_sense, min_gain)
    low, high = _checked_bounds(bounds)
    kept = (np.array([[low, high]]), True)
    if min_gain is not None and f_comm is not None:
        kept = _keeping(f_comm, min_gain, low, high, step)
    every, keeps = kept
    if step is not None:
        allowed, holds = _multiples_allowed(lights, below, every, step)
    else:
        holds, allowed = smallest_level(below, lambda level: _all_below(lights, level, every))
    tones = None
    if near is None and f_comm is not None and (min_gain is None or f_sense is not None):
        tones = [f for f in (f_comm, f_sense) if f is not None]
    chosen = _chosen(allowed, near) if tones is None else _largest_objective(allowed, tones, weights, step)
    left = tuple(float(exposure_modulation(light, chosen)) for light in lights)
    return FlickerFreeExposure(
        chosen,
        max(left),
        holds and keeps,
        left,
        math.nan if tones is None else float(_objective(np.array(chosen), tones, weights)),
        math.nan if f_comm is None else abs(float(np.sinc(f_comm * chosen))),
    )


@dataclass(frozen=True, slots=True)
class FlickerFront:
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
    f_comm: float,
    lights: Sequence[FlickeringLight],
    *,
    bounds: tuple[float, float] | None = None,
    points: int = 20001,
) -> FlickerFront:
    """Gain of the data light and modulation of other lights over exposures, and the efficient exposures.

    Args:
        f_comm: Hz, above 0.
        lights: at least one.
        bounds: (shortest, longest) in s; None: above 0 and up to 0.1 s.
        points: 2 to 10 million, equally spaced. The nulls of the lights within the bounds are added.

    Raises:
        ValueError: an argument outside its range.
    """
    from ocisac_fast.exposure.fronts import efficient_points

    _check(lights, 0.5, None, f_comm, None, None)
    low, high = _checked_bounds(bounds)
    if not 2 <= points <= _MAX_VALUES:
        raise ValueError(f"points: got {points}, allowed: 2 to 10 million")
    nulls = [np.arange(1.0, math.floor(light.frequency * high) + 1.0) / light.frequency for light in lights]
    exposure = np.unique(np.concatenate([np.linspace(low, high, points), *nulls]))
    exposure = exposure[(exposure > 0.0) & (exposure >= low) & (exposure <= high)]
    gain = np.abs(np.sinc(f_comm * exposure))
    modulation = _largest_modulation(lights, exposure)
    return FlickerFront(exposure, gain, modulation, efficient_points(gain, -modulation))


def exposures_below(light: FlickeringLight, below: float, low: float, high: float) -> Float64s:
    """(intervals, 2) in s within ``low`` .. ``high``, ascending, in which the modulation is at most ``below``."""
    slow, fast = light.frequency - light.uncertainty, light.frequency + light.uncertainty
    return clipped(cycles_below(light, below, fast * high) / [slow, fast], low, high)


def cycles_below(light: FlickeringLight, below: float, most: float) -> Float64s:
    """(intervals, 2) of cycles up to ``most``, ascending, in which the modulation is at most ``below``."""
    if light.depth <= below:
        return np.array([[0.0, math.inf]])
    if most > _MAX_NULLS:
        raise ValueError(f"bounds: got {most:.4g} cycles of {light.frequency:g} Hz, allowed: at most a million")
    nulls = np.arange(1.0, math.ceil(most) + 1.0)
    peaks = _peak(light, np.concatenate(([0.0], nulls)))
    under = np.flatnonzero(_modulation(light, peaks) <= below)
    if under.size:  # all later peaks are lower
        nulls = nulls[: under[0]]

    def inside(cycles: Float64s) -> npt.NDArray[np.bool_]:
        return np.asarray(_modulation(light, cycles) <= below)

    begins = _boundary(nulls, peaks[: nulls.size], inside)
    ends = _boundary(nulls, peaks[1 : nulls.size + 1], inside)
    if under.size:
        ends[-1] = math.inf
    return np.column_stack([begins * (1.0 + _SHRINK), ends * (1.0 - _SHRINK)])


def intersection(first: Float64s, second: Float64s) -> Float64s:
    """(intervals, 2) of the intersection of two ascending lists of disjoint intervals."""
    begin = np.searchsorted(second[:, 1], first[:, 0], side="left")
    count = np.maximum(np.searchsorted(second[:, 0], first[:, 1], side="right") - begin, 0)
    which = np.repeat(np.arange(len(first)), count)
    other = np.repeat(begin, count) + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    a, b = first[which], second[other]
    return np.column_stack([np.maximum(a[:, 0], b[:, 0]), np.minimum(a[:, 1], b[:, 1])])


def _modulation(light: FlickeringLight, cycles: Float64s) -> Float64s:
    """Modulation at one frequency. PWM: the overlap of parts d and r of a period varies by min(r, d, 1 - r, 1 - d)."""
    if light.duty is None:
        return np.asarray(light.depth * np.abs(np.sinc(cycles)))
    whole = np.floor(cycles)
    rest = cycles - whole
    swing = np.minimum(np.minimum(rest, 1.0 - rest), min(light.duty, 1.0 - light.duty))
    least = whole * light.duty + np.maximum(rest + light.duty - 1.0, 0.0)
    total = (1.0 - light.depth) * cycles + light.depth * (2.0 * least + swing)
    return np.asarray(np.divide(light.depth * swing, total, out=np.full_like(total, light.depth), where=total > 0.0))


def _peak(light: FlickeringLight, whole: Float64s) -> Float64s:
    """Cycles of the largest modulation between ``whole`` and the next whole number; for a tone tan(pi x) = pi x."""
    if light.duty is not None:
        return np.asarray(whole + min(light.duty, 1.0 - light.duty))
    middle = math.pi * (whole + 0.5)
    angle = middle
    for _ in range(14):  # each divides the error by 20 or more
        angle = middle - np.arctan(1.0 / angle)
    return np.where(whole == 0.0, 0.0, angle / math.pi)


def _boundary(inside: Float64s, outside: Float64s, holds: Callable[[Float64s], npt.NDArray[np.bool_]]) -> Float64s:
    """Bisect between points inside and outside; returns the last points that satisfy ``holds``."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        good = holds(middle)
        inside, outside = np.where(good, middle, inside), np.where(good, outside, middle)
    return inside


def clipped(intervals: Float64s, low: float, high: float) -> Float64s:
    """Intersect the intervals with ``low`` .. ``high``."""
    kept = np.column_stack([np.maximum(intervals[:, 0], low), np.minimum(intervals[:, 1], high)])
    return kept[kept[:, 0] <= kept[:, 1]]


def _all_below(lights: Sequence[FlickeringLight], below: float, every: Float64s) -> Float64s:
    for light in lights:
        if every.size == 0:
            break
        every = intersection(every, exposures_below(light, below, every[0, 0], every[-1, 1]))
    return every


def smallest_level(below: float, found_at: Callable[[float], Float64s]) -> tuple[bool, Float64s]:
    """Return True and the items found at ``below``, or False and those at the smallest level that has any."""
    found = found_at(below)
    if found.size:
        return True, found
    fails, holds, found = below, 1.0, found_at(1.0)
    while holds - fails > 1e-12 * holds:
        middle = 0.5 * (fails + holds)
        some = found_at(middle)
        fails, holds, found = (fails, middle, some) if some.size else (middle, holds, found)
    return False, found


def _multiples_allowed(
    lights: Sequence[FlickeringLight], below: float, every: Float64s, step: float
) -> tuple[Float64s, bool]:
    """Multiples of the step that satisfy the bound, as intervals of length 0, or those of the smallest modulation."""
    grid = _multiples(every, step)
    if grid.size == 0:
        raise ValueError(f"step: got {step}, allowed: a step with a multiple between {every[0, 0]} and {every[-1, 1]}")
    left = _largest_modulation(lights, grid)
    holds = bool(left.min() <= below)
    chosen = grid[left <= (below if holds else left.min())]
    return np.column_stack([chosen, chosen]), holds


def _multiples(every: Float64s, step: float) -> Float64s:
    if not (math.isfinite(step) and step > 0.0):
        raise ValueError(f"step: got {step}, allowed: a finite number above 0 (s)")
    if every[-1, 1] / step > _MAX_VALUES:
        raise ValueError(f"step: got {step}, allowed: at most 10 million multiples up to {every[-1, 1]} s")
    first, last = np.ceil(every[:, 0] / step * (1 - 1e-15)), np.floor(every[:, 1] / step * (1 + 1e-15))
    ranges = [np.arange(max(a, 1.0), b + 1.0) for a, b in zip(first, last, strict=True)]
    return np.asarray(np.unique(np.concatenate(ranges)) * step)


def _keeping(f_comm: float, min_gain: float, low: float, high: float, step: float | None) -> tuple[Float64s, bool]:
    """Exposures that keep the gain of the data light: those between its valleys; all if there are none."""
    every = np.array([[low, high]])
    valleys = cycles_below(FlickeringLight(f_comm), min_gain, f_comm * high + 1.0) / f_comm
    between = np.column_stack([np.concatenate(([0.0], valleys[:, 1])), np.append(valleys[:, 0], math.inf)])
    widened = between * [1.0 - 4 * _SHRINK, 1.0 + 4 * _SHRINK]  # undoes `_SHRINK`: the ends keep the gain
    kept = clipped(widened[between[:, 0] < between[:, 1]], low, high)
    reachable = kept.size > 0 and (step is None or _multiples(kept, step).size > 0)
    return (kept, True) if reachable else (every, False)


def _largest_modulation(lights: Sequence[FlickeringLight], exposure: Float64s) -> Float64s:
    return np.asarray(np.max([exposure_modulation(light, exposure) for light in lights], axis=0))


def _chosen(allowed: Float64s, near: float | None) -> float:
    if near is not None:
        nearest = np.clip(near, allowed[:, 0], allowed[:, 1])
        return float(nearest[np.argmin(np.abs(nearest - near))])
    if allowed[0, 0] == 0.0:
        raise ValueError("bounds: got 0 as the shortest, allowed: above 0 (s), since every short exposure holds")
    return float(allowed[0, 0])


def _objective(exposure: Float64s, tones: Sequence[float], weights: Sequence[float]) -> Float64s:
    first, second = tones[0], tones[-1]
    pair = weights if len(tones) == 2 else (1.0, 0.0)
    return np.asarray(exposure_objective(exposure, first, second, weights=pair))


def _largest_objective(
    allowed: Float64s, tones: Sequence[float], weights: Sequence[float], step: float | None
) -> float:
    """Exposure that maximises eq. 18 within the intervals; of equals, the shortest."""
    exposures = allowed[:, 0]
    if step is None:
        pair = weights if len(tones) == 2 else (1.0, 0.0)
        lengthy = allowed[allowed[:, 1] > allowed[:, 0]]
        peaks = [float(best_exposure(tones[0], tones[-1], weights=pair, bounds=(a, b)).exposure) for a, b in lengthy]
        exposures = np.unique(np.concatenate([allowed.ravel(), peaks]))
    exposures = exposures[exposures > 0.0]
    return float(exposures[np.argmax(_objective(exposures, tones, weights))])


def _check(
    lights: Sequence[FlickeringLight],
    below: float,
    near: float | None,
    f_comm: float | None,
    f_sense: float | None,
    min_gain: float | None,
) -> None:
    if len(lights) == 0:
        raise ValueError("lights: got none, allowed: at least one")
    if not 0.0 < below < 1.0:
        raise ValueError(f"below: got {below}, allowed: above 0 and below 1")
    for name, value, unit in (("near", near, "s"), ("f_comm", f_comm, "Hz"), ("f_sense", f_sense, "Hz")):
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name}: got {value}, allowed: a finite number above 0 ({unit})")
    if min_gain is not None and not 0.0 < min_gain < 1.0:
        raise ValueError(f"min_gain: got {min_gain}, allowed: above 0 and below 1")
    for light in lights:
        if f_comm is not None and abs(f_comm - light.frequency) <= light.uncertainty:
            raise ValueError(f"f_comm: got {f_comm}, allowed: none of the lights to avoid")
    if f_comm is None and (f_sense is not None or min_gain is not None):
        raise ValueError("f_comm: got None, allowed: a frequency (Hz), needed for f_sense and min_gain")


def _checked_bounds(bounds: tuple[float, float] | None) -> tuple[float, float]:
    low, high = (0.0, LONGEST_EXPOSURE) if bounds is None else bounds
    if not (0.0 <= low <= high < math.inf and high > 0.0):
        raise ValueError(f"bounds: got {low} to {high}, allowed: 0 <= shortest <= longest, above 0 (s)")
    return low, high
