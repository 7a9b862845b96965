"""The catalogue of limits: each entry sweeps one quantity and measures a plain method and the library beside the truth.

One definition serves the tests, the picture and docs/limits.md. A new limit is one more function under ``@limit``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.flags import Flag
from ocisac_fast.tones.gain import ToneGain

Float64s = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Point:
    """One place of a sweep.

    Attributes:
        x: the swept quantity.
        plain: error of the plain method, RMS over the columns; inf or NaN where it has none to give.
        library: error of the library; NaN where it refuses to answer.
        told: standard error that the library gives with it, RMS over the columns; 0 where it gives none.
        flags: those that at least half of the columns carry.
        lost: the equaliser's report lists the light's frequency among those it could not restore.
    """

    x: float
    plain: float
    library: float
    told: float
    flags: Flag = Flag(0)  # noqa: RUF009, a constant
    lost: bool = False

    def answered(self, limit: Limit) -> str:
        """``"good"``, ``"honest"`` (within twice what the library tells), ``"flagged"`` or ``"silent"``."""
        if self.library <= limit.good:
            return "good"
        if self.library <= 2.0 * self.told:
            return "honest"
        return "flagged" if self.flags & limit.flags or self.lost else "silent"


@dataclass(frozen=True)
class Limit:
    """Where a plain method fails, and what the library does there.

    Attributes:
        name: key.
        title: over the panel.
        sweep: the swept quantity, with its unit.
        error: the error, with its unit.
        plain: the plain method.
        why: it fails.
        then: what the library does.
        spot: x at which figures are quoted.
        fails_by: least error of the plain method at ``spot``.
        good: error up to which an answer is a good one.
        flags: those that tell of the limit.
        silent: x at which the library is neither good nor honest nor flagged; ``then`` says so.
        measure: the points of the sweep, in order.
    """

    name: str
    title: str
    sweep: str
    error: str
    plain: str
    why: str
    then: str
    spot: float
    fails_by: float
    good: float
    flags: Flag
    silent: tuple[float, ...]
    measure: Callable[[], list[Point]]

    def point_at_spot(self, points: Iterable[Point]) -> Point:
        """The one whose figures are quoted."""
        return next(point for point in points if point.x == self.spot)


LIMITS: list[Limit] = []


def limit(
    name: str,
    title: str,
    *,
    sweep: str,
    error: str,
    plain: str,
    why: str,
    then: str,
    spot: float,
    fails_by: float,
    good: float,
    flags: Flag = Flag(0),  # noqa: B008, a constant
    silent: tuple[float, ...] = (),
) -> Callable[[Callable[[], list[Point]]], Callable[[], list[Point]]]:
    """Enters a measuring function into ``LIMITS``."""

    def enter(measure: Callable[[], list[Point]]) -> Callable[[], list[Point]]:
        texts = (name, title, sweep, error, plain, why, then)
        LIMITS.append(Limit(*texts, spot, fails_by, good, flags, silent, measure))
        return measure

    return enter


def rms(values: npt.ArrayLike) -> float:
    """Root of the mean square; NaN if any value is."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values, dtype=np.float64)))))


def shared_flags(masks: npt.NDArray[np.uint32]) -> Flag:
    """The bits that at least half of the columns carry."""
    return reduce(or_, (bit for bit in Flag if 2 * np.count_nonzero(masks & bit) >= masks.size), Flag(0))


def compared(x: float, truth: npt.ArrayLike, plain: npt.ArrayLike, found: ToneGain | Any, scale: float = 1.0) -> Point:
    """Gains of a plain method and of the library beside the truth; errors times ``scale``."""
    plain_error, error = (rms(scale * (np.asarray(values) - truth)) for values in (plain, found.gain))
    return Point(x, plain_error, error, rms(scale * found.gain_std), shared_flags(np.atleast_1d(found.flags)))
