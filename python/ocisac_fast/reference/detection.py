"""Detectors of chips, by whole matrices: H[n, k] is the share of chip k in the exposure of row n."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.chips.channel import ChannelEstimate, ClockErrors
from ocisac_fast.chips.detection import DetectedChips, DetectorErrorRates, DetectorMethod
from ocisac_fast.reference.equalization import equalize
from ocisac_fast.reference.light import linear_light
from ocisac_fast.reference.sequence_detection import detect_sequence

FloatArray = npt.NDArray[np.float64]


def detect_chips(
    columns: npt.ArrayLike, camera: Camera, channel: ChannelEstimate, method: DetectorMethod = "wiener"
) -> DetectedChips:
    """As the equations say, for every column of every frame; ``mlse`` and ``reduced`` decide but weigh all chips alike.

    With x = chips - 1/2 of variance 1/4 and noise sigma the best linear estimate of x is A^-1 H^T (rows - 1/2)/sigma^2,
    A = H^T H/sigma^2 + 4; for ``dfe`` the same of each chip and those after it, with the decisions before taken out of
    the rows. ``auto`` is not here: it is a choice, no detector.
    """
    array = np.asarray(columns)
    frames = array.reshape((1,) * (3 - max(array.ndim, 2)) + array.shape + (1,) * (array.ndim < 2))
    light = linear_light(frames, camera)
    rows = light.shape[1]
    dark, bright = channel.levels(rows)
    signals = (light - dark[:, None]) / (bright - dark)[:, None]
    middle = float(np.polynomial.legendre.legval(0.0, channel.swing))
    noise = max(channel.noise / middle, 1e-4)
    channel = replace(channel, exposure_rows=max(channel.exposure_rows, 1e-3))
    half = channel.exposure_rows / 2
    first, last = (int(np.floor((row - channel.phase) / channel.rows_per_chip)) for row in (-half, rows - 1 + half))
    chips = np.arange(first, last + 1)
    llr = np.empty((frames.shape[0], chips.size, frames.shape[2]))
    for frame in range(frames.shape[0]):
        for column in range(frames.shape[2]):
            llr[frame, :, column] = _detect(signals[frame, :, column], channel, noise, chips, method)
    return DetectedChips(llr[0, :, 0] if array.ndim == 1 else llr[0] if array.ndim == 2 else llr, first, method)


def _detect(
    rows: FloatArray, channel: ChannelEstimate, noise: float, chips: npt.NDArray[Any], method: str
) -> FloatArray:
    box = _shares(np.arange(rows.size), chips, channel.rows_per_chip, channel.phase, channel.exposure_rows)
    if method in ("mlse", "reduced"):
        clock = {name: getattr(channel, name) for name in ("rows_per_chip", "phase", "exposure_rows")}
        return 2 * detect_sequence(rows, **clock, noise=noise, first=int(chips[0]), count=chips.size) - 1
    if method in ("slicer", "inverse"):
        return _by_threshold(rows, channel, noise, chips, box, method)
    normal = box.T @ box / noise**2 + 4 * np.eye(chips.size)
    right = box.T @ (rows - 0.5) / noise**2
    if method == "wiener":
        inverse = np.linalg.inv(normal)
        return np.asarray(inverse @ right / np.diag(inverse))
    if method != "dfe":
        raise ValueError(f"method: got {method!r}, allowed: a detector")
    llr = np.empty(chips.size)
    for k in range(chips.size):
        inverse = np.linalg.inv(normal[k:, k:])
        decided = np.where(llr[:k] > 0, 0.5, -0.5)
        llr[k] = (inverse @ (right[k:] - normal[k:, :k] @ decided))[0] / inverse[0, 0]
    return llr


def _by_threshold(
    rows: FloatArray, channel: ChannelEstimate, noise: float, chips: npt.NDArray[Any], box: FloatArray, method: str
) -> FloatArray:
    period, middles = channel.rows_per_chip, channel.phase + (chips + 0.5) * channel.rows_per_chip
    if method == "slicer":
        weights = _windows(middles, max(0.4 * (period - channel.exposure_rows), 0.5), rows.size)
        gains = weights @ box
        own = np.diag(gains)
        variance = (np.sum(gains**2, axis=1) - own**2) / 4 + noise**2 * np.sum(weights**2, axis=1)
        seen = weights.sum(axis=1) > 0
        return np.where(seen, (weights @ rows - 0.5) * own / np.where(variance > 0, variance, 1), 0.0)
    light = _equalized(rows, channel.exposure_rows)
    weights = _windows(middles - channel.exposure_rows / 2, max(0.4 * period, 0.5), rows.size)
    own_gain, others, variance = _inverse_response(channel, noise)
    seen = weights.sum(axis=1) > 0
    return np.where(seen, (weights @ light - 0.5) * own_gain / (variance + np.sum(others**2) / 4), 0.0)


def _inverse_response(channel: ChannelEstimate, noise: float) -> tuple[float, FloatArray, float]:
    """Gain of a chip, of those around it, variance of the noise: one chip, and one row, in the middle of many rows."""
    period, exposure_rows = channel.rows_per_chip, channel.exposure_rows
    length = 24 * exposure_rows + 32 * period + 128
    count = int(length)
    phase = channel.phase + np.floor(0.5 * length - channel.phase - 0.5 * period)
    chip = _equalized(_shares(np.arange(count), np.zeros(1), period, phase, exposure_rows)[:, 0], exposure_rows)
    row = _equalized((np.arange(count) == count // 2).astype(float), exposure_rows)
    away = np.arange(-np.floor(0.4 * length / period), np.floor(0.4 * length / period) + 1)
    gains = _windows(phase + (away + 0.5) * period - exposure_rows / 2, max(0.4 * period, 0.5), count) @ chip
    window = _windows(np.array([phase + 0.5 * period - exposure_rows / 2]), max(0.4 * period, 0.5), count)[0]
    kernel = np.convolve(row, window[window > 0][::-1], mode="valid")
    return float(gains[away == 0][0]), gains[away != 0], float(noise**2 * np.sum(kernel**2))


def _equalized(rows: FloatArray, exposure_rows: float) -> FloatArray:
    return equalize(rows, Camera(row_time=1.0, exposure=exposure_rows), "inverse")


def _shares(
    rows: npt.ArrayLike, chips: npt.NDArray[Any], period: float, phase: float, exposure_rows: float
) -> FloatArray:
    """(rows, chips); they sum to 1 where the chips cover the row's exposure."""
    length = max(exposure_rows, 1e-3)
    begin, low = phase + chips * period, np.asarray(rows)[:, None] - length / 2
    overlap = np.minimum(low + length, begin + period) - np.maximum(low, begin)
    return np.asarray(np.maximum(overlap, 0) / length)


def _windows(middles: FloatArray, reach: float, rows: int) -> FloatArray:
    """(chips, rows): overlap of each row's place with the middle of each chip, sum 1; 0 beyond the rows."""
    row = np.arange(rows)
    overlap = np.minimum(middles[:, None] + reach, row + 0.5) - np.maximum(middles[:, None] - reach, row - 0.5)
    overlap = np.maximum(overlap, 0)
    total = overlap.sum(axis=1, keepdims=True)
    return np.asarray(overlap / np.where(total > 0, total, 1))


def detector_error_rates(rows_per_chip: float, exposure_rows: float, noise: float) -> DetectorErrorRates:
    """Mean over four places of the chips to the rows, for one chip in the middle of a long frame.

    Weights of the rows times H are the gains g of the chips; the share of wrong chips is the probability that
    g_0/2 + sum of +-g_j/2 + noise is below 0, by its characteristic function (Gil-Pelaez 1951).
    """
    exposure_rows, rates = max(exposure_rows, 1e-3), np.zeros(5)
    chips = np.arange(8 * int(np.ceil(exposure_rows / rows_per_chip)) + 25)
    middle = chips.size // 2
    for place in range(4):
        phase = -exposure_rows / 2 - rows_per_chip * (place + 0.5) / 4
        count = int((chips.size - 1) * rows_per_chip - exposure_rows - 1)
        box = _shares(np.arange(count), chips, rows_per_chip, phase, exposure_rows)
        normal = box.T @ box / noise**2 + 4 * np.eye(chips.size)
        window = _windows(
            np.array([phase + (middle + 0.5) * rows_per_chip]),
            max(0.4 * (rows_per_chip - exposure_rows), 0.5),
            count,
        )[0]
        rates[0] += _error_rate(np.roll(window @ box, -middle), noise**2 * np.sum(window**2)) / 4
        rates[1] += _inverse_error_rate(rows_per_chip, exposure_rows, phase, noise) / 4
        for number, start in ((2, 0), (3, middle)):
            column = np.linalg.inv(normal[start:, start:])[middle - start]
            gains = np.roll((np.arange(column.size) == middle - start) - 4 * column, -(middle - start))
            rates[number] += _error_rate(gains, column[middle - start] - 4 * np.sum(column**2)) / 4
        rates[4] += (
            _union_bound(normal - 4 * np.eye(chips.size), middle, int(np.ceil(exposure_rows / rows_per_chip))) / 4
        )
    return DetectorErrorRates(*rates)


def _inverse_error_rate(rows_per_chip: float, exposure_rows: float, phase: float, noise: float) -> float:
    errors = ClockErrors(0, np.zeros((3, 3)))
    clock = (rows_per_chip, phase, exposure_rows, errors)
    own, others, variance = _inverse_response(
        ChannelEstimate(*clock, np.zeros(1), np.ones(1), noise, (0, 1), True), noise
    )
    return _error_rate(np.concatenate([[own], others]), variance)


def _error_rate(gains: FloatArray, variance: float) -> float:
    """P(gains[0]/2 + sum of +-gains[1:]/2 + noise < 0); the integral by the midpoint rule."""
    step = np.pi / (np.sum(np.abs(gains)) + 8 * np.sqrt(variance)) / 2
    at = step * np.arange(0.5, 9 / (np.sqrt(variance) * step))
    characteristic = np.exp(-0.5 * variance * at**2) * np.prod(np.cos(0.5 * np.outer(gains[1:], at)), axis=0)
    return float(max(0.5 - step / np.pi * np.sum(characteristic * np.sin(0.5 * gains[0] * at) / at), 0))


def _union_bound(squares: FloatArray, chip: int, band: int) -> float:
    patterns = [((0,), (1,)), ((0, 1), (1, -1)), ((0, 1, 2), (1, -1, 1))]
    patterns += [((0, 1, gap, gap + 1), (1, -1, 1, -1)) for gap in (band, band - 1) if gap > 1]
    total = 0.0
    for places, signs in patterns:
        at = chip + np.array(places)
        distance = np.sqrt(max(np.array(signs) @ squares[np.ix_(at, at)] @ np.array(signs), 0))
        total += len(places) * 2.0 ** (1 - len(places)) * 0.5 * math.erfc(distance / 2 / math.sqrt(2))
    return min(total, 0.5)
