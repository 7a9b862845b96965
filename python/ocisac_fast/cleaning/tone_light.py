"""Estimation of the light of each row of a banded picture as a tone with harmonics."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cleaning.columns import Columns, FloatArray, explained, slow_terms
from ocisac_fast.core.flags import Flag

_STEPS_TO_FOLLOW = 10  # of the fit to another frame, with known shares
_MUCH_LIKELIER = 0.01  # min. decrease of the misfit


@dataclass(frozen=True, slots=True, eq=False)
class ToneLight:
    """Light of each row, mean 1; frequency, Hz; number of harmonics."""

    light: FloatArray
    frequency: float
    harmonics: int


def tone_light(
    picture: Columns, rows: FloatArray, weight: FloatArray, row_time: float, enough: float | None
) -> ToneLight | None:
    """Fit mean, harmonics and slow terms at the estimated frequency; None if they do not explain the rows.

    ``enough``: min. share of the rows' swing that the tone explains, or None for no bound.

    Periodic texture contributes to the rows too. It has few edges, so the tone is then fitted to the picture itself.
    """
    from ocisac_fast.tones.frequency import find_frequency

    found = find_frequency(rows[:, None], Camera(row_time=1.0))
    if not np.isfinite(found.frequency) or (Flag.NO_TONE in found.flags and enough is not None):
        return None
    frequency = found.frequency
    periodic = _harmonics(len(rows), found.harmonics, frequency)
    basis = np.concatenate([slow_terms(len(rows)), periodic], axis=1)
    root = np.sqrt(weight)
    fitted = np.linalg.lstsq(basis * root[:, None], rows * root, rcond=None)[0]
    if enough is not None and explained(rows, basis @ fitted, weight) < enough:
        return None
    tones = periodic * fitted[-periodic.shape[1] :]
    fundamental = tones[:, [0, periodic.shape[1] // 2]]
    best = _likeliest(picture, tones.sum(axis=1), fundamental.sum(axis=1), found.harmonics, frequency)
    return replace(best, frequency=best.frequency / row_time)


def with_frequency(picture: Columns, tone: ToneLight, frequency: float, row_time: float) -> ToneLight:
    """The tone, fitted to the picture again at a given frequency, Hz."""
    basis = _periodic_basis(len(tone.light), tone.harmonics, frequency * row_time)
    fitted = np.linalg.lstsq(basis, picture.refined(tone.light, basis, steps=24)[0], rcond=None)[0]
    return ToneLight(_fully_modulated(basis[:, 1:] @ fitted[1:]), frequency, tone.harmonics)


def followed(picture: Columns, tone: ToneLight, row_time: float) -> ToneLight:
    """The tone in another frame, of any phase; its frequency, one Gauss-Newton step from that of ``tone``."""
    light, frequency = _tone_of_picture(
        picture, np.ones_like(tone.light), tone.harmonics, tone.frequency * row_time, steps=_STEPS_TO_FOLLOW
    )
    return ToneLight(light, frequency / row_time, tone.harmonics)


def _likeliest(
    picture: Columns, all_of_rows: FloatArray, fundamental: FloatArray, harmonics: int, frequency: float
) -> ToneLight:
    """The fundamental alone, or with harmonics if these decrease the misfit clearly.

    Periodic texture resembles harmonics if the fit starts with those of the rows, so both starts are tried."""
    best = _fitted_to(picture, fundamental, 1, frequency)
    if harmonics == 1:
        return best
    lag = max(round(0.25 / frequency), 1)
    least = picture.misfit(best.light, lag)
    for start in (fundamental, all_of_rows):
        tried = _fitted_to(picture, start, harmonics, frequency)
        misfit = picture.misfit(tried.light, lag)
        if misfit < least - _MUCH_LIKELIER:
            best, least = tried, misfit
    return best


def _fitted_to(picture: Columns, start: FloatArray, harmonics: int, frequency: float) -> ToneLight:
    light = _fully_modulated(start)
    for _ in range(2):
        light, frequency = _tone_of_picture(picture, light, harmonics, frequency)
    return ToneLight(light, frequency, harmonics)


def _periodic_basis(rows: int, harmonics: int, frequency: float) -> FloatArray:
    """(rows, terms): a constant, then `_harmonics`."""
    return np.concatenate([np.ones((rows, 1)), _harmonics(rows, harmonics, frequency)], axis=1)


def _harmonics(rows: int, harmonics: int, frequency: float) -> FloatArray:
    """(rows, terms) cosines, then sines, of the harmonics below half the row rate, phases from the middle row."""
    order = np.arange(1, harmonics + 1)
    order = order[order * frequency < 0.5]
    cycles = 2 * np.pi * (np.outer(np.arange(rows) - 0.5 * (rows - 1), order * frequency) % 1.0)
    return np.concatenate([np.cos(cycles), np.sin(cycles)], axis=1)


def _tone_of_picture(
    picture: Columns, light: FloatArray, harmonics: int, frequency: float, steps: int = 24
) -> tuple[FloatArray, float]:
    """Fit the tone to the picture, and its frequency f by one Gauss-Newton step; d/df is proportional to t."""
    rows = len(light)
    periodic = _periodic_basis(rows, harmonics, frequency)
    half, time = periodic.shape[1] // 2, np.arange(rows) - 0.5 * (rows - 1)
    drift = time[:, None] * periodic[:, [1, 1 + half]] / rows
    basis = np.concatenate([periodic, drift], axis=1)
    fitted = np.linalg.lstsq(basis, picture.refined(light, basis, steps=steps)[0], rcond=None)[0]
    cosine, sine = fitted[1], fitted[1 + half]
    change = (fitted[-2] * sine - fitted[-1] * cosine) / (2 * np.pi * rows * max(cosine**2 + sine**2, 1e-300))
    if abs(change) * rows > 0.25:  # cycles: outside the range of a linear step
        change = 0.0
    moved = _harmonics(rows, harmonics, frequency + change)
    return _fully_modulated(moved @ fitted[1:-2]), frequency + change


def _fully_modulated(tone: FloatArray) -> FloatArray:
    """Scale to mean 1 and a minimum of 0."""
    swing = tone - tone.mean()
    darkest = -float(swing.min())
    return 1.0 + swing / darkest if darkest > 1e-9 else np.ones_like(tone)
