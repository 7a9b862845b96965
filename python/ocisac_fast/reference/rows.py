"""Row signals of a lamp in the field: profile along the rows, lit rows, other light, and the slope of a lamp."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Profile = tuple[FloatArray, FloatArray]  # dark, swing of each row


def _near_mean(values: FloatArray, smooth: int) -> FloatArray:
    """Means over up to ``smooth`` rows on either side."""
    return np.array([values[max(n - smooth, 0) : n + smooth + 1].mean() for n in range(len(values))])


def first_profile(signals: FloatArray, smooth: int) -> Profile | None:
    """Mean of (frames, rows), and that mean times the relative standard deviation over the frames, smoothed.

    Reflectance and profile scale mean and deviation alike. None: fewer than two frames, a mean that is not above 0, or
    no variation.
    """
    if len(signals) < 2:
        return None
    dark = signals.mean(axis=0)
    if not (dark > 0).all():
        return None
    swing = dark * np.sqrt(_near_mean(signals.var(axis=0) / dark**2, smooth))
    return (dark, swing) if swing.max() > 0 else None


def fit_profile(
    signals: FloatArray, exposed: FloatArray, shape: npt.ArrayLike, smooth: int, weight: float
) -> Profile | None:
    """Least squares of y = dark + swing * s, row by row over the frames (frames, rows), with a prior.

    The prior draws the swing to shape times the least-squares ratio of swing to shape over the rows nearby, with
    ``weight`` times the mean information of a row. Rows of shape 0 stay 0. None: fewer than three frames, or no chips.
    """
    if len(signals) < 3:
        return None
    form = np.asarray(shape, dtype=np.float64)
    away = exposed - exposed.mean(axis=0)
    squares, products = (away**2).sum(axis=0), (away * (signals - signals.mean(axis=0))).sum(axis=0)
    if not squares.mean() > 0:
        return None
    nearby, common = _near_mean(squares * form**2, smooth), _near_mean(products * form, smooth)
    fitted = (nearby > 0) & (common > 0) & (form != 0)
    ratio = np.divide(common, nearby, out=np.zeros(form.size), where=fitted)
    prior = weight * squares.mean()
    swing = np.where(fitted, (products + prior * form * ratio) / np.where(fitted, squares + prior, 1), 0)
    return np.where(fitted, signals.mean(axis=0) - swing * exposed.mean(axis=0), 0), swing


def profile_rows(swing: npt.ArrayLike, share: float) -> tuple[int, int]:
    """First row, and one after the last, of the first longest run above ``share`` of the largest swing."""
    values = np.asarray(swing, dtype=np.float64)
    above = np.concatenate([[False], values > share * values.max(), [False]]).astype(int)
    begins, ends = np.flatnonzero(np.diff(above) == 1), np.flatnonzero(np.diff(above) == -1)
    if not begins.size:
        return 0, 0
    longest = int(np.argmax(ends - begins))
    return int(begins[longest]), int(ends[longest])


def remove_nuisance(
    signal: npt.ArrayLike, slow: float, tones: Sequence[float], exposed: npt.ArrayLike, scale: npt.ArrayLike = ()
) -> tuple[FloatArray, float]:
    """Signal minus slow light and tones of one least-squares fit with a constant and the chips, and its residual.

    Slow light: cosines of half periods of the frame, up to ``slow`` cycles per row. Tones (cycles per row) have seven
    harmonics, one if the chips are unknown (``exposed`` empty). Both are multiplied by ``scale`` (rows), unless it is
    empty. The chips' swing is a parabola along the frame.
    """
    values, chips = np.asarray(signal, dtype=np.float64), np.asarray(exposed, dtype=np.float64)
    rows = len(values)
    row = np.arange(rows)
    cosines = range(1, math.ceil(2 * rows * slow) + 1)
    other = [np.cos(np.pi * k * (row + 0.5) / rows) for k in cosines]
    for tone in tones:
        for harmonic in range(1, 8 if chips.size else 2):
            if harmonic * tone < 0.5:
                angle = 2 * np.pi * harmonic * tone * row
                other += [np.cos(angle), np.sin(angle)]
    if np.size(scale):
        other = [np.asarray(scale) * column for column in other]
    along = np.linspace(-1, 1, rows)
    swings = [chips * along**k for k in range(3)] if chips.size else []
    model = np.stack([np.ones(rows), *other, *swings], axis=1)
    fitted = np.linalg.lstsq(model, values, rcond=None)[0]
    rest = values - model[:, 1 : len(other) + 1] @ fitted[1 : len(other) + 1]
    return rest, float(np.sum((values - model @ fitted) ** 2))


def without_square_wave(signal: npt.ArrayLike, frequency: float, exposure_rows: float = 0.0) -> FloatArray:
    """Signal minus the square wave of duty 1/2, exposed for ``exposure_rows``, with the smallest residual.

    Exhaustive: 25 frequencies within 0.6 spectral lines of the frame of ``frequency`` (cycles per row), phases half a
    row apart; heights above 0. Then the eight neighbours of the best, four times, with steps halved each time.
    """
    values = np.asarray(signal, dtype=np.float64)
    row = np.arange(len(values))
    best, rest, place = 0.0, values, (frequency, 0.0)

    def integral(cycles: npt.ArrayLike) -> FloatArray:
        share = np.mod(np.asarray(cycles, dtype=np.float64), 1)
        return np.asarray(0.5 * np.minimum(share, 1 - share), dtype=np.float64)

    def try_wave(tried: float, phase: float) -> None:
        nonlocal best, rest, place
        cycles, part = tried * row + phase, tried * exposure_rows
        if part <= 1e-6:
            wave = np.where(np.mod(cycles, 1) < 0.5, 0.5, -0.5)
        else:
            wave = (integral(cycles + 0.5 * part) - integral(cycles - 0.5 * part)) / part
        away = wave - wave.mean()
        height = away @ values / (away @ away)
        gain = height**2 * (away @ away)
        if height > 0 and gain > best * (1 + 1e-12):
            best, rest, place = gain, values - height * wave, (tried, phase)

    frequency_step, phase_step = 0.6 / (12 * len(values)), 0.5 * frequency
    for step in range(-12, 13):
        tried = frequency + step * frequency_step
        phase = 0.0
        while phase < 1:
            try_wave(tried, phase)
            phase += 0.5 * tried
    for _ in range(4):
        frequency_step, phase_step = 0.5 * frequency_step, 0.5 * phase_step
        near, at = place
        for f in (-1, 0, 1):
            for p in (-1, 0, 1):
                try_wave(near + f * frequency_step, at + p * phase_step - 0.5 * len(values) * f * frequency_step)
    return rest


def turning_points(signal: FloatArray, hysteresis: float) -> list[int]:
    """Row 0, then alternating maxima and minima, confirmed once the signal leaves them by more than ``hysteresis``."""
    points = [0]
    last, rising = 0, 0
    for row in range(len(signal)):
        since = signal[last : row + 1]
        high, low = last + int(np.argmax(since)), last + int(np.argmin(since))
        if rising >= 0 and signal[high] - signal[row] > hysteresis:
            turned, rising = high, -1
        elif rising <= 0 and signal[row] - signal[low] > hysteresis:
            turned, rising = low, 1
        else:
            continue
        points += [turned] if turned != points[-1] else []
        last = row
    since = signal[last:]
    end = last + int(np.argmax(since) if rising > 0 else np.argmin(since))
    return points + ([end] if end != points[-1] else [])


def lit_rows(
    signal: npt.ArrayLike,
    noise: float,
    seen: tuple[int, int],
    least_departure: float = 0.125,
    texture: float = 0.0,
    most_noise: float = 0.04,
    expected: bool = False,
) -> tuple[tuple[int, int], int]:
    """Rows less long steady runs at either end, and the lower quartile of the runs between turning points.

    A run at an end is dark if it is longer than one and a half times the longest run between turning points; if it is,
    where dark rows are not expected (nor rows beyond ``seen``), longer than four times the second longest and sixteen
    times that quartile; and if half of it is straight within noise and texture (of its median), which are bounded by
    ``most_noise`` of the span. It ends where the signal leaves its median by 4.5 of their standard deviations and
    ``least_departure`` of the span, and the next row is on the same side by half as much.
    """
    values = np.asarray(signal, dtype=np.float64)
    rows = len(values)
    if rows < 2:
        return seen, 0
    ordered = np.sort(values)
    span = ordered[rows - 1 - rows // 50] - ordered[rows // 50]
    spread = min(noise, most_noise * span) if math.isfinite(noise) else 0.0
    points = turning_points(values, max(8 * spread, 0.15 * span))
    if len(points) < 10:
        return seen, 0
    runs = np.sort(np.diff(points[2:-1]))
    shortest, longest = int(runs[len(runs) // 4]), int(runs[-1])

    def dark(part: FloatArray, run: int, beyond: bool) -> int:
        """Dark rows at the end of ``part``, of which the last ``run`` show no turning point."""
        enough = max(1.5 * longest, 0 if beyond or expected else max(16 * shortest, 4 * int(runs[-2])))
        half = part[rows - run // 2 :]
        if run <= enough:
            return 0
        level = np.sort(half)[half.size // 2]
        uneven = math.hypot(spread, texture * level)
        line = np.polyval(np.polyfit(np.arange(half.size), half, min(1, half.size - 1)), np.arange(half.size))
        if np.sqrt(np.mean((half - line) ** 2)) > max(0.01 * span, 2 * min(uneven, 0.5 * most_noise * span)):
            return 0
        departure = max(4.5 * min(uneven, most_noise * span), least_departure * span)
        off = (part - level)[::-1]  # from the end on
        beside = np.append(off[1:], 2 * off[-1])
        lit = (np.abs(off) > departure) & (np.sign(off) * beside > 0.5 * departure)
        return int(np.argmax(lit)) if lit.any() else rows

    begin = dark(values[::-1], points[2], seen[0] > 0) or seen[0]
    end = rows - dark(values, rows - 1 - points[-2], seen[1] < rows)
    end = seen[1] if end == rows else end
    return ((begin, end) if begin < end else seen), shortest


def lamp_slope(swings: FloatArray, centres: npt.ArrayLike) -> float:
    """Slope of a lamp in columns per row from (blocks, rows) swings of groups of columns; 0 if not significant.

    In windows of about 60 rows the blocks' loadings follow from two steps of the power method, from the strongest
    block. A line through the loadings' centroids, weighted by their power, is significant from six standard errors and
    from half of the light's standard deviation on.
    """
    columns = np.asarray(centres, dtype=np.float64)
    rows = swings.shape[1]
    count = rows // 60
    if len(columns) < 3 or count < 4:
        return 0.0
    lights = [_centroid(swings[:, w * rows // count : (w + 1) * rows // count], columns) for w in range(count)]
    lights = [(row + w * rows // count, *others) for w, (row, *others) in enumerate(lights)]
    row, column, spread, swing = np.array(lights).T
    kept = swing > 0.2 * swing.max()
    if np.count_nonzero(kept) < 4:
        return 0.0
    row, column, spread, weight = row[kept], column[kept], spread[kept], swing[kept] ** 2 / np.sum(swing[kept] ** 2)
    away = row - weight @ row
    slope = float(weight @ (away * (column - weight @ column)) / (weight @ away**2))
    left = weight @ (column - weight @ column - slope * away) ** 2
    error = math.sqrt(left / (len(row) - 2) / (weight @ away**2))
    significant = abs(slope) > 6 * error and abs(slope) * (row[-1] - row[0]) > 0.5 * (weight @ spread)
    return slope if significant else 0.0


def _centroid(block: FloatArray, columns: FloatArray) -> tuple[float, float, float, float]:
    """Mean row of the light's power, mean and standard deviation of its columns, and its swing."""
    power = (block**2).sum(axis=1)
    common = block[int(np.argmax(power))]
    loadings = np.zeros(len(columns))
    for _ in range(2):
        loadings = block @ common
        largest = float(loadings.max())
        loadings = np.where(loadings < 0.2 * largest, 0, loadings)
        common = loadings @ block
    if not largest > 0:
        return 0.0, 0.0, 0.0, 0.0
    column = loadings @ columns / loadings.sum()
    spread = math.sqrt(loadings @ (columns - column) ** 2 / loadings.sum())
    energy = common @ common
    row = float(common**2 @ np.arange(len(common)) / energy)
    return row, float(column), spread, math.sqrt(energy) / float(loadings @ loadings)
