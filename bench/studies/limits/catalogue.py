"""The catalogue of limits: each entry sweeps one quantity and compares a plain method and the library with the truth.

One definition serves the tests, the picture and the table of docs/measured/limits.md, whose texts say why the plain
method fails and what the library does. A new limit is one more function under ``@limit``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.flags import Flag
from ocisac_fast.tones.gain import ToneGain
from studies.chart.measuring import rms as rms

Measuring = Callable[[], "Iterator[Point]"]


@dataclass(frozen=True)
class Point:
    """One value of a sweep; errors are RMS over the columns."""

    x: float  # the swept quantity
    plain: float  # error of the plain method; inf or NaN without a result
    library: float  # error of the library; NaN if it gives no estimate
    stated: float  # standard error that the library reports; 0: as good as rounding, NaN: none
    flags: Flag = Flag(0)  # noqa: RUF009, a constant; those of at least half of the columns
    lost: bool = False  # reported as not restored: the light's frequency (equaliser), or the picture (remarks)

    def answered(self, limit: Limit) -> str:
        """``"good"``, ``"honest"`` (within twice the reported standard error), ``"flagged"`` or ``"silent"``."""
        if self.library <= limit.good:
            return "good"
        if self.library <= 2.0 * self.stated:
            return "honest"
        return "flagged" if self.flags & limit.flags or self.lost else "silent"


@dataclass(frozen=True)
class Limit:
    """A limit of a plain method, and the library's behaviour there."""

    name: str  # key
    title: str  # over the panel
    sweep: str  # the swept quantity, with its unit
    error: str  # with its unit
    spot: float  # x at which figures are quoted
    fails_by: float  # min. error of the plain method at the spot
    good: float  # max. error of a good result
    measure: Callable[[], list[Point]]  # the points of the sweep, in order
    flags: Flag = Flag(0)  # noqa: RUF009, a constant; those that indicate the limit
    silent: tuple[float, ...] = ()  # x without a good, honest or flagged answer; docs/measured/limits.md explains it

    def point_at_spot(self, points: Iterable[Point]) -> Point:
        """The point whose figures are quoted."""
        return next(point for point in points if point.x == self.spot)


LIMITS: list[Limit] = []


def limit(title: str, sweep: str, error: str = "RMS error of the gain", **about: Any) -> Callable[[Measuring], None]:
    """Enter a measuring function, whose name is the key, with the other attributes of its :class:`Limit`."""

    def enter(measure: Measuring) -> None:
        name = measure.__name__.strip("_").replace("_", "-")
        LIMITS.append(Limit(name, title, sweep, error, measure=lambda: list(measure()), **about))

    return enter


def shared_flags(masks: npt.NDArray[np.uint32]) -> Flag:
    """The bits set in at least half of the columns."""
    return reduce(or_, (bit for bit in Flag if 2 * np.count_nonzero(masks & bit) >= masks.size), Flag(0))


def compared(x: float, truth: npt.ArrayLike, plain: npt.ArrayLike, found: ToneGain | Any, scale: float = 1.0) -> Point:
    """Compare gains of a plain method and of the library with the truth; errors times ``scale``."""
    plain_error, error = (rms(scale * (np.asarray(values) - truth)) for values in (plain, found.gain))
    return Point(x, plain_error, error, rms(scale * found.gain_std), shared_flags(np.atleast_1d(found.flags)))
