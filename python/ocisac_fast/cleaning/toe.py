"""The toe of a tone curve: dim light stored darker than the curve says, found from chips, which add up in light alone.

Light x is stored as s = x^2/(x + t W), W full light: as x where it is bright, less t W; as a power of two where it is
dim. No light stays none.
"""

from __future__ import annotations

import numpy as np

from ocisac_fast.cleaning.chip_light import unexplained
from ocisac_fast.cleaning.columns import Columns, FloatArray, lit_colours

_LADDER = (1 / 32, 1 / 8)  # tried in turn; what is cleaned hardly differs in between
_LESS_LEFT = 0.6  # of what chips leave unexplained without a toe: noise of the rows alone may leave 0.64


def lifted(stored: FloatArray, toe: float, white: float) -> FloatArray:
    """Light of what is stored of it; below dark mirrored."""
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
    """Change of light for one of what is stored; finite in black."""
    if toe == 0.0:
        return np.ones_like(stored)
    s = np.maximum(np.abs(stored), 2e-4 * white)
    return np.asarray(0.5 + 0.5 * (s + 2 * toe * white) / np.sqrt(s * (s + 4 * toe * white)))


def with_toe(light: FloatArray, variance: FloatArray, toe: float, white: float) -> tuple[FloatArray, FloatArray]:
    """Light and its noise variance, both without the toe that they were stored with."""
    return lifted(light, toe, white), variance * slope(light, toe, white) ** 2 if toe > 0.0 else variance


def find_toe(light: FloatArray, variance: FloatArray, white: float) -> float:
    """Toe of one frame (rows, columns, colours) under chips: the one with which they explain most, or 0."""

    colours = lit_colours(light, variance)
    light, variance = light[..., colours], variance[..., colours]

    def left(toe: float) -> float:
        lit, certain = with_toe(light, variance, toe, white)
        return unexplained(*Columns(lit.sum(axis=2), certain.sum(axis=2)).free())

    without = least = left(0.0)
    best = 0.0
    for toe in _LADDER:
        now = left(toe)
        if now >= least:
            break
        best, least = toe, now
    return best if least < _LESS_LEFT * without else 0.0
