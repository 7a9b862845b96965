"""The channel by finite differences and `lstsq`, detectors by full matrices, sequences by exhaustive states."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.chips.channel import (
    ChannelEstimate,
    ChipClock,
    ClockErrors,
    Pooled,
)
from ocisac_fast.chips.detection import DetectedChips, DetectorErrorRates
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.reference.camera import linear_light
from ocisac_fast.reference.tones import equalize


def detect_sequence(
    rows: Float64s,
    rows_per_chip: float,
    phase: float,
    exposure_rows: float,
    noise: float | Float64s,
    first: int,
    count: int,
) -> Float64s:
    """Detect chips first ... first + count - 1 as the sequence with the least squared error (Viterbi).

    A :data:`ocisac_fast.chips.channel.Detect`: rows are 0 for steady dark and 1 for steady bright, chip 0 begins at row
    ``phase``. A state consists of the chips before the newest that its rows still see: 2^ceil(exposure / rows_per_chip)
    states. For white noise the result is independent of its size; ``noise`` may be that of each row.
    """
    length = max(exposure_rows, 1e-3) / rows_per_chip
    memory = max(int(np.ceil(length)), 1)
    history = np.arange(2 << memory)  # bit j: chip - j
    bits = (history[:, None] >> np.arange(memory + 1)) & 1
    ends = (np.arange(len(rows)) + exposure_rows / 2 - phase) / rows_per_chip - first
    newest = np.floor(ends).astype(int)
    weights = np.broadcast_to(np.asarray(noise, dtype=float), len(rows)) ** -2.0
    cost = np.zeros(1 << memory)
    origin = np.zeros((count, 1 << memory), dtype=np.int64)
    for chip in range(count):
        seen = newest == chip
        end = ends[seen] - chip
        back = np.arange(memory + 1)
        overlap = np.minimum(end[:, None], 1 - back) - np.maximum(end[:, None] - length, -back)
        expected = bits @ np.maximum(overlap, 0).T / length
        paths = cost[history >> 1] + (rows[seen] - expected) ** 2 @ weights[seen]
        low, high = paths[: 1 << memory], paths[1 << memory :]  # oldest chip: 0, 1
        origin[chip] = np.where(high < low, history[1 << memory :], history[: 1 << memory]) >> 1
        cost = np.minimum(low, high)
    state = int(np.argmin(cost))
    chips = np.zeros(count)
    for chip in reversed(range(count)):
        chips[chip] = state & 1
        state = int(origin[chip, state])
    return chips


def chip_llr(
    rows: npt.ArrayLike,
    clock: ChipClock,
    *,
    noise: float,
    first: int,
    count: int,
) -> Float64s:
    """Exhaustive search: least squares over all sequences with a chip bright, and with it dark. At most 16 chips."""
    if count > 16:
        raise ValueError(f"count: got {count}, allowed: at most 16")
    if count == 0:
        return np.zeros(0)
    values = np.asarray(rows, dtype=float)
    sequences = (np.arange(1 << count)[:, None] >> np.arange(count)) & 1
    chips = first + np.arange(count)
    shares = _shares(np.arange(len(values)), chips, clock.rows_per_chip, clock.phase, clock.exposure_rows)
    expected = sequences @ shares.T
    cost = np.sum((values - expected) ** 2, axis=1) / (2 * noise**2)
    least = [np.where(sequences == bit, cost[:, None], np.inf).min(axis=0) for bit in (0, 1)]
    return np.asarray(least[0] - least[1])


def closest_pair_distance(rows_per_chip: float, exposure_rows: float) -> float:
    """Square root of the mean, over all phases of the chips, of the sum of squared differences of the rows.

    It is an integral of parabolas between the ends of the chips in the exposure, by Simpson's rule.
    """
    length = exposure_rows / rows_per_chip

    def difference(ends: Float64s) -> Float64s:
        area = [np.clip(at, 0, 1) - np.clip(at - 1, 0, 1) for at in (ends, ends - length)]
        return np.asarray((area[0] - area[1]) / length)

    ends = np.unique([0, 1, 2, length, 1 + length, 2 + length])
    begin, end = ends[:-1], ends[1:]
    squares = [difference(at) ** 2 for at in (begin, (begin + end) / 2, end)]
    return float(np.sqrt(rows_per_chip * np.sum((end - begin) / 6 * (squares[0] + 4 * squares[1] + squares[2]))))


def expose_chips(chips: npt.ArrayLike, rows: int, clock: ChipClock, *, first: int = 0) -> Float64s:
    """Sum of chips times their overlap with the row's exposure; the first and last chip extend to infinity."""
    numbers = np.array([clock.rows_per_chip, clock.phase, clock.exposure_rows])
    return _exposed(np.asarray(chips, dtype=float), rows, numbers, first)


def _exposed(levels: Float64s, rows: int, clock: Float64s, first: int) -> Float64s:
    """:func:`expose_chips` for rows per chip, phase and exposure in ``clock``."""
    rows_per_chip, phase, exposure_rows = clock
    length = max(exposure_rows, 1e-3)
    edges = phase + (first + np.arange(len(levels) + 1)) * rows_per_chip
    edges[0], edges[-1] = -np.inf, np.inf
    begin = np.arange(rows)[:, None] - length / 2
    overlap = np.minimum(edges[1:], begin + length) - np.maximum(edges[:-1], begin)
    return np.asarray(np.maximum(overlap, 0) @ levels / length)


def rows_of(chips: int, rows: int, clock: Float64s, first: int) -> tuple[int, int]:
    """First row that sees known chips only, and the one after the last."""
    rows_per_chip, phase, exposure_rows = clock
    begin = phase + first * rows_per_chip + exposure_rows / 2
    end = phase + (first + chips) * rows_per_chip - exposure_rows / 2
    low = int(np.clip(np.ceil(begin), 0, rows))
    return low, int(np.clip(np.floor(end) + 1, low, rows))


def legendre(rows: int, degree: int) -> Float64s:
    """(rows, degree + 1) Legendre polynomials over -1 ... 1."""
    along = np.linspace(-1, 1, rows) if rows > 1 else np.zeros(1)
    return np.asarray(np.polynomial.legendre.legvander(along, degree), dtype=float)


def derivatives(chips: Float64s, rows: int, clock: Float64s, first: int) -> Float64s:
    """(rows, 3) derivatives of s by phase (of the middle chip), rows per chip and exposure, by central differences.

    s is piecewise linear: a difference is exact unless a chip's edge lies within its step of the exposure's end.
    """
    middle = first + len(chips) // 2

    def exposed(phase: float, rows_per_chip: float, exposure_rows: float) -> Float64s:
        start = phase - middle * rows_per_chip
        return _exposed(chips, rows, np.array([rows_per_chip, start, exposure_rows]), first)

    period, phase, exposure_rows = clock
    steps = 1e-6, 1e-6 / len(chips), 1e-6
    at = phase + middle * period, period, exposure_rows
    columns = []
    for k, step in enumerate(steps):
        offset = np.eye(3)[k] * step
        columns.append((exposed(*(at + offset)) - exposed(*(at - offset))) / (2 * step))
    return np.stack(columns, axis=1)


def invert(normal: Float64s, exposure_known: bool) -> Float64s | None:
    """(3, 3) covariance of the clock for unit noise; an undetermined exposure has infinite variance."""
    for unknowns in ([0, 1],) if exposure_known else ([0, 1, 2], [0, 1]):
        kept = unknowns + list(range(3, len(normal)))
        part = normal[np.ix_(kept, kept)]
        scale = np.sqrt(np.diag(part))
        if (scale == 0).any() or np.linalg.eigvalsh(part / np.outer(scale, scale))[0] < 1e-10:
            continue
        covariance = np.diag([0.0, 0.0, 0.0 if exposure_known else np.inf])
        covariance[np.ix_(unknowns, unknowns)] = np.linalg.inv(part)[: len(unknowns), : len(unknowns)]
        return covariance
    return None


def fit_channel(
    signal: npt.ArrayLike,
    chips: npt.ArrayLike,
    clock: ChipClock,
    *,
    first: int = 0,
    exposure_known: bool = False,
    dark_degree: int = 1,
    swing_degree: int = 0,
) -> ChannelEstimate | None:
    """Gauss-Newton: levels by least squares for the clock, then a joint step, halved until the squares decrease."""
    values, levels = np.asarray(signal, dtype=float), np.asarray(chips, dtype=float)
    rows, middle = len(values), first + len(levels) // 2
    dark, swing = legendre(rows, dark_degree), legendre(rows, swing_degree)
    at = np.array([clock.rows_per_chip, clock.phase, max(clock.exposure_rows, 1e-3)])
    used: tuple[int, int] | None = None

    def linear(clock: Float64s, kept: slice) -> tuple[Float64s, Float64s, Float64s]:
        s = _exposed(levels, rows, clock, first)
        design = np.hstack([dark, swing * s[:, None]])[kept]
        solution = np.linalg.lstsq(design, values[kept], rcond=None)[0]
        return design, solution, values[kept] - design @ solution

    def jacobian_of(solution: Float64s, design: Float64s, kept: slice) -> Float64s:
        height = (swing @ solution[dark_degree + 1 :])[:, None]
        return np.hstack([(height * derivatives(levels, rows, at, first))[kept], design])

    for _ in range(3):
        now = rows_of(len(levels), rows, at, first)
        if now == used:
            break
        used, kept = now, slice(*now)
        design, solution, residual = linear(at, kept)
        if now[1] - now[0] <= design.shape[1] + 2 + (not exposure_known):
            return None
        if np.linalg.matrix_rank(design) < design.shape[1]:
            return None
        for _ in range(40):
            jacobian = jacobian_of(solution, design, kept)
            covariance = invert(jacobian.T @ jacobian, exposure_known)
            if covariance is None:
                return None
            keep_exposure = not np.isfinite(covariance[2, 2]) or exposure_known
            step = np.zeros(jacobian.shape[1])
            kept_columns = [0, 1, *([] if keep_exposure else [2]), *range(3, jacobian.shape[1])]
            step[kept_columns] = np.linalg.lstsq(jacobian[:, kept_columns], residual, rcond=None)[0]
            change = np.array([step[1], step[0] - middle * step[1], step[2]])
            share = 1.0
            while share > 1e-3:
                trial = at + share * change
                trial[2] = max(trial[2], 1e-3)
                better = linear(trial, kept)
                if better[2] @ better[2] <= residual @ residual:
                    break
                share /= 2
            else:
                break
            moved = np.abs(trial - at).max()
            at, (design, solution, residual) = trial, better
            if moved < 1e-12:
                break
    assert used is not None
    variance = residual @ residual / (len(residual) - len(solution) - 2 - (not exposure_known))
    jacobian = jacobian_of(solution, design, kept)
    covariance = invert(jacobian.T @ jacobian, exposure_known)
    if covariance is None:
        return None
    errors, split = ClockErrors(middle, variance * covariance), dark_degree + 1
    period, phase, exposure_rows, noise = map(float, (*at, np.sqrt(variance)))
    levels_at = solution[:split], solution[split:]
    return ChannelEstimate(period, phase, exposure_rows, errors, *levels_at, noise, used, True)


def clock_bounds(
    chips: npt.ArrayLike,
    swing: npt.ArrayLike,
    clock: ChipClock,
    *,
    noise: float,
    first: int = 0,
    exposure_known: bool = False,
    dark_degree: int = 1,
    swing_degree: int = 0,
) -> ClockErrors | None:
    """Inverse of the Fisher information J^T J / noise^2, J the derivatives of the rows by all unknowns."""
    levels, height = np.asarray(chips, dtype=float), np.asarray(swing, dtype=float)
    rows = len(height)
    at = np.array([clock.rows_per_chip, clock.phase, max(clock.exposure_rows, 1e-3)])
    kept = slice(*rows_of(len(levels), rows, at, first))
    s = _exposed(levels, rows, at, first)
    by_clock = height[:, None] * derivatives(levels, rows, at, first)
    jacobian = np.hstack([by_clock, legendre(rows, dark_degree), legendre(rows, swing_degree) * s[:, None]])[kept]
    if len(jacobian) < jacobian.shape[1] - exposure_known:
        return None
    covariance = invert(jacobian.T @ jacobian, exposure_known)
    return None if covariance is None else ClockErrors(first + len(levels) // 2, noise**2 * covariance)


def pool_estimates(values: npt.ArrayLike, errors: npt.ArrayLike) -> Pooled:
    """Weighted mean; its error is that of the weights or of the scatter, whichever is larger."""
    x, e = np.asarray(values, dtype=float), np.asarray(errors, dtype=float)
    counts = np.isfinite(x) & np.isfinite(e) & (e > 0)
    x, w = x[counts], e[counts] ** -2.0
    if not len(x):
        return Pooled(float("nan"), float("nan"), 0)
    mean = float(np.average(x, weights=w))
    scatter = float(w @ (x - mean) ** 2) / (len(x) - 1) if len(x) > 1 else 1.0
    return Pooled(mean, float(np.sqrt(max(scatter, 1.0) / w.sum())), len(x))


def detect_chips(
    columns: npt.ArrayLike, camera: Camera, channel: ChannelEstimate, method: str = "wiener"
) -> DetectedChips:
    """Detect chips in every column of every frame by the equations; ``mlse`` and ``reduced`` are hard decisions with
    equal weights.

    With x = chips - 1/2 of variance 1/4 and noise sigma the best linear estimate of x is A^-1 H^T (rows - 1/2)/sigma^2,
    A = H^T H/sigma^2 + 4. ``dfe`` applies it to each chip and those after it, after subtraction of the decided chips.
    ``auto`` is missing, since it selects among detectors.
    """
    array = np.asarray(columns)
    frames = array.reshape((1,) * (3 - max(array.ndim, 2)) + array.shape + (1,) * (array.ndim < 2))
    light = linear_light(frames, camera)
    rows = light.shape[1]
    dark, bright = channel.levels(rows)
    signals = (light - dark[:, None]) / (bright - dark)[:, None]
    noise = np.maximum(channel.noise / (bright - dark), 1e-4)
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
    rows: Float64s, channel: ChannelEstimate, noise: Float64s, chips: npt.NDArray[Any], method: str
) -> Float64s:
    box = _shares(np.arange(rows.size), chips, channel.rows_per_chip, channel.phase, channel.exposure_rows)
    if method in ("mlse", "reduced"):
        clock = {name: getattr(channel, name) for name in ("rows_per_chip", "phase", "exposure_rows")}
        return 2 * detect_sequence(rows, **clock, noise=noise, first=int(chips[0]), count=chips.size) - 1
    if method in ("slicer", "inverse"):
        return _by_threshold(rows, channel, noise, chips, box, method)
    normal = box.T / noise**2 @ box + 4 * np.eye(chips.size)
    right = box.T / noise**2 @ (rows - 0.5)
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
    rows: Float64s, channel: ChannelEstimate, noise: Float64s, chips: npt.NDArray[Any], box: Float64s, method: str
) -> Float64s:
    period, middles = channel.rows_per_chip, channel.phase + (chips + 0.5) * channel.rows_per_chip
    if method == "slicer":
        weights = _windows(middles, max(0.4 * (period - channel.exposure_rows), 0.5), rows.size)
        gains = weights @ box
        own = np.diag(gains)
        variance = (np.sum(gains**2, axis=1) - own**2) / 4 + weights**2 @ noise**2
        seen = weights.sum(axis=1) > 0
        return np.where(seen, (weights @ rows - 0.5) * own / np.where(variance > 0, variance, 1), 0.0)
    light = _equalized(rows, channel.exposure_rows)
    weights = _windows(middles - channel.exposure_rows / 2, max(0.4 * period, 0.5), rows.size)
    middle = float(np.polynomial.legendre.legval(0.0, channel.swing))
    own_gain, others, variance = _inverse_response(channel, max(channel.noise / middle, 1e-4))
    seen = weights.sum(axis=1) > 0
    return np.where(seen, (weights @ light - 0.5) * own_gain / (variance + np.sum(others**2) / 4), 0.0)


def _inverse_response(channel: ChannelEstimate, noise: float) -> tuple[float, Float64s, float]:
    """Gain of a chip, gains of its neighbours and noise variance, from one chip and one row amid many rows."""
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


def _equalized(rows: Float64s, exposure_rows: float) -> Float64s:
    return equalize(rows, Camera(row_time=1.0, exposure=exposure_rows))


def _shares(
    rows: npt.ArrayLike, chips: npt.NDArray[Any], period: float, phase: float, exposure_rows: float
) -> Float64s:
    """(rows, chips) overlaps; their sum is 1 where the chips cover the row's exposure."""
    length = max(exposure_rows, 1e-3)
    begin, low = phase + chips * period, np.asarray(rows)[:, None] - length / 2
    overlap = np.minimum(low + length, begin + period) - np.maximum(low, begin)
    return np.asarray(np.maximum(overlap, 0) / length)


def _windows(middles: Float64s, reach: float, rows: int) -> Float64s:
    """(chips, rows): overlap of each row with the middle of each chip, sum 1; 0 outside the rows."""
    row = np.arange(rows)
    overlap = np.minimum(middles[:, None] + reach, row + 0.5) - np.maximum(middles[:, None] - reach, row - 0.5)
    overlap = np.maximum(overlap, 0)
    total = overlap.sum(axis=1, keepdims=True)
    return np.asarray(overlap / np.where(total > 0, total, 1))


def detector_error_rates(rows_per_chip: float, exposure_rows: float, noise: float) -> DetectorErrorRates:
    """Mean over four phases of the chips relative to the rows, for one chip in the middle of a long frame.

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


def _error_rate(gains: Float64s, variance: float) -> float:
    """P(gains[0]/2 + sum of +-gains[1:]/2 + noise < 0), integrated by the midpoint rule."""
    step = np.pi / (np.sum(np.abs(gains)) + 8 * np.sqrt(variance)) / 2
    at = step * np.arange(0.5, 9 / (np.sqrt(variance) * step))
    characteristic = np.exp(-0.5 * variance * at**2) * np.prod(np.cos(0.5 * np.outer(gains[1:], at)), axis=0)
    return float(max(0.5 - step / np.pi * np.sum(characteristic * np.sin(0.5 * gains[0] * at) / at), 0))


def _union_bound(squares: Float64s, chip: int, band: int) -> float:
    patterns = [((0,), (1,)), ((0, 1), (1, -1)), ((0, 1, 2), (1, -1, 1))]
    patterns += [((0, 1, gap, gap + 1), (1, -1, 1, -1)) for gap in (band, band - 1) if gap > 1]
    total = 0.0
    for places, signs in patterns:
        at = chip + np.array(places)
        distance = np.sqrt(max(np.array(signs) @ squares[np.ix_(at, at)] @ np.array(signs), 0))
        total += len(places) * 2.0 ** (1 - len(places)) * 0.5 * math.erfc(distance / 2 / math.sqrt(2))
    return min(total, 0.5)
