"""Share of the light in every pixel of every colour: one for each pixel, or one for the whole picture."""

from __future__ import annotations

import numpy as np

from ocisac_fast import _core
from ocisac_fast.cleaning.columns import FloatArray

_MAX_TRIED_COLUMNS = 256  # of a picture, in its middle, for the gain by chance
_CLEAR_GAIN = 0.1  # of the log-likelihood of a pair of pixels; by chance at most 0.03
_GAIN_OVER_CHANCE = 2.0  # pictures under an even light have 0.8 to 1.6, lights that cost 1 dB with one share 2 and more
_MIN_LEFT = 0.02  # lower bound of a light that is a divisor
_STEPS = 40


def colour_shares(light: FloatArray, variance: FloatArray, rows: FloatArray) -> FloatArray:
    """Shares (rows, columns, colours) of the row lights (frames, colours, rows) in frames of one scene.

    ``light``, ``variance``: (frames, rows, columns, colours), linear.

    A light that is the only one, or that lights all alike, has one share. Shares by pixel then follow texture. They
    replace one share for each colour only where they increase the likelihood more than they do by chance: twice as much
    as for an even light that is put onto the cleaned picture, with the course of this one, moved along the rows.
    """
    pictures = [
        (np.ascontiguousarray(light[..., k]), np.ascontiguousarray(variance[..., k]), np.ascontiguousarray(rows[:, k]))
        for k in range(light.shape[3])
    ]
    maps = [_core.light_share(*picture, True) for picture in pictures]
    single = [_one_share(*picture, share) for picture, share in zip(pictures, maps, strict=True)]
    gain = sum(_gain(*picture, share, one) for picture, share, one in zip(pictures, maps, single, strict=True))
    if gain < _CLEAR_GAIN * len(maps) and gain < _GAIN_OVER_CHANCE * sum(
        _gain_by_chance(*picture, share, one) for picture, share, one in zip(pictures, maps, single, strict=True)
    ):
        maps = [np.full_like(share, one) for share, one in zip(maps, single, strict=True)]
    return np.stack(maps, axis=-1)


def _left(rows: FloatArray, share: FloatArray | float) -> FloatArray:
    return np.maximum(1 + share * (rows[:, :, None] - 1), _MIN_LEFT)


def _misfit(light: FloatArray, variance: FloatArray, rows: FloatArray, share: FloatArray | float) -> float:
    return _core.row_misfit(light, variance, rows, np.asarray(share), _core.comparison_lag(rows))


def _one_share(light: FloatArray, variance: FloatArray, rows: FloatArray, share: FloatArray) -> float:
    """The likeliest share of all pixels, within 0.1 of the median of their own ones."""
    middle = float(np.median(share))
    tried = np.linspace(max(middle - 0.1, 0.0), min(middle + 0.1, 1.0), _STEPS + 1)
    every = max(1, light.shape[2] // _MAX_TRIED_COLUMNS)
    light, variance = (np.ascontiguousarray(values[..., ::every]) for values in (light, variance))
    return float(tried[np.argmin([_misfit(light, variance, rows, one) for one in tried])])


def _gain(light: FloatArray, variance: FloatArray, rows: FloatArray, share: FloatArray, one: float) -> float:
    return _misfit(light, variance, rows, one) - _misfit(light, variance, rows, share)


def _gain_by_chance(light: FloatArray, variance: FloatArray, rows: FloatArray, share: FloatArray, one: float) -> float:
    """The larger gain of two places for the light: moves by m and N - m rows correlate alike with the light itself."""
    start = max(0, light.shape[2] - _MAX_TRIED_COLUMNS) // 2
    middle = slice(start, start + _MAX_TRIED_COLUMNS)
    gains = []
    for sign in (1, -1):
        moved = np.stack([np.roll(of_frame, sign * _move_unlike(of_frame)) for of_frame in rows])
        change = _left(moved, one) / _left(rows, share[:, middle])
        even = np.ascontiguousarray(light[..., middle] * change)
        spread = np.ascontiguousarray(variance[..., middle] * change**2)
        found = _core.light_share(even, spread, moved, True)
        gains.append(_gain(even, spread, moved, found, _one_share(even, spread, moved, found)))
    return max(gains)


def _move_unlike(rows: FloatArray) -> int:
    """The move, a quarter to half of the frame, at which the row light correlates least with itself."""
    swing = rows - rows.mean()
    moves = range(len(rows) // 4, len(rows) // 2 + 1)
    return min(moves, key=lambda move: abs(float(swing @ np.roll(swing, move))))
