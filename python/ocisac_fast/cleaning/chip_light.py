"""Estimation of the light of each row of a banded picture as chips: on or off, with one response."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast._core import ColumnBundles
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag

FloatArray = npt.NDArray[np.float64]

_ENOUGH = 0.92  # min. share of the rows' swing, after `levelled`, that chips explain
_TOP_REACH, _LONGEST_RUN = 3, 48  # rows: half width of a top; half width of the window in which tops are compared
_MIN_TOP = 0.3  # share of the largest row within the longest run
_KNOT_ROWS = 0.8  # max. spacing of the knots of the response; at most a quarter of a chip
_OWN_SWING = 0.015  # deviation of a row from the chips' model: sharpening follows no response


@dataclass(frozen=True, slots=True, eq=False)
class ChipLight:
    """Light of each row, mean 1, and chip rate, Hz."""

    light: FloatArray
    rate: float


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    basis: FloatArray  # (rows, terms)
    light: FloatArray
    rate: float  # chips per row
    explained: float


def chip_light(
    picture: ColumnBundles, rows: FloatArray, weight: FloatArray, row_time: float, *, always: bool
) -> ChipLight | None:
    """Refine the estimated ``rows`` with a model of chips; None if chips do not explain them.

    The rows drift: the picture contributes to their slow changes. Chips are detected without its influence, and their
    response is then fitted to the differences of neighbouring rows of the picture.
    """
    fits = [fit for fit in (_fit(levelled(rows), weight), _fit(rows, weight)) if fit is not None]
    if not fits or (fits[0].explained < _ENOUGH and not always):
        return None
    best = max(fits, key=lambda fit: fit.explained)
    light = _core.fully_modulated_rows(best.light)
    for _ in range(2):
        within = best.basis @ np.linalg.lstsq(best.basis, light, rcond=None)[0]
        light = _core.fully_modulated_rows(picture.refined(within, best.basis)[0])
    light = _core.fully_modulated_rows(picture.refined(light, deviation=_OWN_SWING)[0])
    return ChipLight(light, best.rate / row_time)


def unexplained(rows: FloatArray, weight: FloatArray) -> float:
    """Share of the rows' swing, after :func:`levelled`, that chips of one response leave unexplained; 1 without chips.

    Chips are additive in linear light only: a wrong tone curve increases the share.
    """
    fit = _fit(levelled(rows), weight)
    return 1.0 if fit is None else 1.0 - fit.explained


def levelled(rows: FloatArray) -> FloatArray:
    """Divide the rows by the line through the tops of bright runs, which all reach the level of full light."""
    low = np.minimum(rows, 1.5 * np.quantile(rows, 0.95))
    tops = np.flatnonzero((low >= _largest(low, _TOP_REACH)) & (low > _MIN_TOP * _largest(low, _LONGEST_RUN)))
    if len(tops) == 0:
        return rows
    return np.asarray(low / np.exp(np.interp(np.arange(len(rows)), tops, np.log(low[tops]))))


def _largest(values: FloatArray, reach: int) -> FloatArray:
    padded = np.pad(values, reach, constant_values=-np.inf)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).max(axis=1))


def _fit(rows: FloatArray, weight: FloatArray) -> _Fit | None:
    """Detect chips, estimate those cut by the ends of the picture, and fit the response by least squares.

    A second response for pairs of consecutive bright chips allows for different rise and fall of the light. The
    explained share excludes it.
    """
    from ocisac_fast.receiver.blind import receive

    got = receive(rows[:, None], Camera(row_time=1.0))[0]
    if len(got.bits) < 8 or Flag.NO_SIGNAL in got.flags:
        return None
    length, count = got.rows_per_chip, len(rows)
    before, after = int(np.ceil(got.phase / length)) + 1, int(np.ceil((count - got.phase) / length)) - len(got.bits)
    bits = np.array([0.0] * before + [float(bit) for bit in got.bits] + [0.0] * max(after, 0))
    each = _responses(len(bits), count, length, got.phase - before * length)
    terms = 1 + each.shape[2]
    if count < 4 * terms:
        return None
    guessed = [*range(before - 1, -1, -1), *range(before + len(got.bits), len(bits))]
    root = np.sqrt(weight)
    for _ in range(3):
        basis = np.concatenate([np.ones((count, 1)), np.einsum("nck,c->nk", each, bits)], axis=1)
        fitted = np.linalg.lstsq(basis * root[:, None], rows * root, rcond=None)[0]
        for k in guessed:
            rest = rows - basis @ fitted + bits[k] * (each[:, k] @ fitted[1:])
            shape = each[:, k] @ fitted[1:]
            bit = float(2 * (weight * rest) @ shape > (weight * shape) @ shape)
            basis[:, 1:] += (bit - bits[k]) * each[:, k]
            bits[k] = bit
    share = _core.explained_share(rows, basis @ fitted, weight)
    if count >= 8 * terms:
        pairs = np.append(bits[:-1] * bits[1:], 0.0)
        basis = np.concatenate([basis, np.einsum("nck,c->nk", each, pairs)], axis=1)
        fitted = np.linalg.lstsq(basis * root[:, None], rows * root, rcond=None)[0]
    return _Fit(basis, basis @ fitted, got.chip_rate, share)


def _responses(chips: int, rows: int, rows_per_chip: float, start: float) -> FloatArray:
    """(rows, chips, knots): triangular basis of the time since a chip's ramp begins, from -1 to 2 chips."""
    step = 1.0 / np.ceil(max(4.0, rows_per_chip / _KNOT_ROWS))
    knots = np.arange(round(3.0 / step) + 1) * step - 1.0
    since = (np.arange(rows)[:, None, None] - start) / rows_per_chip - np.arange(chips)[:, None]
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(since - knots) / step))
