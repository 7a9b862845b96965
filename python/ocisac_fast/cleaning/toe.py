"""The toe of a tone curve, which stores dim light darker than the curve; estimated from chips, additive in light only.

Light x is stored as s = x^2/(x + t W), where W is full light and t the toe: s is about x - t W for bright light and
x^2/(t W) for dim light; s(0) = 0.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast._core import ColumnBundles

FloatArray = npt.NDArray[np.float64]

_LADDER = (1 / 32, 1 / 8)  # candidates in order; values in between give nearly the same picture
_LESS_LEFT = 0.6  # max. ratio of the unexplained shares with and without toe; noise of the rows alone may give 0.64


def lifted(stored: FloatArray, toe: float, white: float) -> FloatArray:
    """Light of a stored value; odd symmetry below dark."""
    if toe == 0.0:
        return stored
    s = np.abs(stored)
    return np.asarray(np.copysign(0.5 * (s + np.sqrt(s * (s + 4 * toe * white))), stored))


def lowered(light: FloatArray, toe: float, white: float) -> FloatArray:
    """The inverse of :func:`lifted`."""
    if toe == 0.0:
        return light
    return np.asarray(light * np.abs(light) / (np.abs(light) + toe * white))


def slope(stored: FloatArray, toe: float, white: float) -> FloatArray:
    """Derivative of :func:`lifted`, finite in black."""
    if toe == 0.0:
        return np.ones_like(stored)
    s = np.maximum(np.abs(stored), 2e-4 * white)
    return np.asarray(0.5 + 0.5 * (s + 2 * toe * white) / np.sqrt(s * (s + 4 * toe * white)))


def with_toe(light: FloatArray, variance: FloatArray, toe: float, white: float) -> tuple[FloatArray, FloatArray]:
    """Light and its noise variance after removal of the toe."""
    return lifted(light, toe, white), variance * slope(light, toe, white) ** 2 if toe > 0.0 else variance


def find_toe(light: FloatArray, variance: FloatArray, white: float) -> float:
    """Estimate the toe of one frame (rows, columns, colours) under chips: the candidate with the best fit, or 0."""

    colours = _core.alike_colours(light, variance)[0]
    light, variance = light[..., colours], variance[..., colours]

    def left(toe: float) -> float:
        lit, certain = with_toe(light, variance, toe, white)
        return _core.unexplained_by_chips(*ColumnBundles(lit.sum(axis=2), certain.sum(axis=2)).free())

    without = least = left(0.0)
    best = 0.0
    for toe in _LADDER:
        now = left(toe)
        if now >= least:
            break
        best, least = toe, now
    return best if least < _LESS_LEFT * without else 0.0
