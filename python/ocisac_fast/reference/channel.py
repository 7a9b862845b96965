"""Estimation of the channel in plain NumPy: overlaps added up, derivatives by differences, one `lstsq` a step."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ocisac_fast.chips.channel import (
    ChannelEstimate,
    ClockErrors,
    Detect,
    Pooled,
    PreambleMatch,
    RefinedChannel,
    TrackedClock,
)
from ocisac_fast.reference.sequence_detection import detect_sequence

FloatArray = npt.NDArray[np.float64]


def expose_chips(
    chips: npt.ArrayLike, rows: int, *, rows_per_chip: float, phase: float, exposure_rows: float, first: int = 0
) -> FloatArray:
    """Sum of chips times the overlap of each with the row's exposure; the chips at the ends go on for ever."""
    levels = np.asarray(chips, dtype=float)
    length = max(exposure_rows, 1e-3)
    edges = phase + (first + np.arange(len(levels) + 1)) * rows_per_chip
    edges[0], edges[-1] = -np.inf, np.inf
    begin = np.arange(rows)[:, None] - length / 2
    overlap = np.minimum(edges[1:], begin + length) - np.maximum(edges[:-1], begin)
    return np.asarray(np.maximum(overlap, 0) @ levels / length)


def rows_of(chips: int, rows: int, clock: FloatArray, first: int) -> tuple[int, int]:
    """First row that sees known chips only, and the one after the last."""
    rows_per_chip, phase, exposure_rows = clock
    begin = phase + first * rows_per_chip + exposure_rows / 2
    end = phase + (first + chips) * rows_per_chip - exposure_rows / 2
    low = int(np.clip(np.ceil(begin), 0, rows))
    return low, int(np.clip(np.floor(end) + 1, low, rows))


def legendre(rows: int, degree: int) -> FloatArray:
    """(rows, degree + 1) over -1 ... 1."""
    along = np.linspace(-1, 1, rows) if rows > 1 else np.zeros(1)
    return np.asarray(np.polynomial.legendre.legvander(along, degree), dtype=float)


def derivatives(chips: FloatArray, rows: int, clock: FloatArray, first: int) -> FloatArray:
    """(rows, 3) of s by phase (of the middle chip), rows per chip and exposure, by central differences.

    s is linear in pieces: a difference is exact unless a chip's edge lies within its step of the exposure's end.
    """
    middle = first + len(chips) // 2

    def exposed(phase: float, rows_per_chip: float, exposure_rows: float) -> FloatArray:
        start = phase - middle * rows_per_chip
        return expose_chips(
            chips, rows, rows_per_chip=rows_per_chip, phase=start, exposure_rows=exposure_rows, first=first
        )

    period, phase, exposure_rows = clock
    steps = 1e-6, 1e-6 / len(chips), 1e-6
    at = phase + middle * period, period, exposure_rows
    columns = []
    for k, step in enumerate(steps):
        offset = np.eye(3)[k] * step
        columns.append((exposed(*(at + offset)) - exposed(*(at - offset))) / (2 * step))
    return np.stack(columns, axis=1)


def invert(normal: FloatArray, exposure_known: bool) -> FloatArray | None:
    """(3, 3) covariance of the clock for a unit noise; an exposure that nothing tells has an infinite variance."""
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
    *,
    rows_per_chip: float,
    phase: float,
    exposure_rows: float,
    first: int = 0,
    exposure_known: bool = False,
    dark_degree: int = 1,
    swing_degree: int = 0,
) -> ChannelEstimate | None:
    """Gauss-Newton: levels by least squares for the clock, then a step of everything, halved until the squares fall."""
    values, levels = np.asarray(signal, dtype=float), np.asarray(chips, dtype=float)
    rows, middle = len(values), first + len(levels) // 2
    dark, swing = legendre(rows, dark_degree), legendre(rows, swing_degree)
    clock = np.array([rows_per_chip, phase, max(exposure_rows, 1e-3)])
    used: tuple[int, int] | None = None

    def linear(clock: FloatArray, kept: slice) -> tuple[FloatArray, FloatArray, FloatArray]:
        period, start, length = clock
        s = expose_chips(levels, rows, rows_per_chip=period, phase=start, exposure_rows=length, first=first)
        design = np.hstack([dark, swing * s[:, None]])[kept]
        solution = np.linalg.lstsq(design, values[kept], rcond=None)[0]
        return design, solution, values[kept] - design @ solution

    for _ in range(3):
        now = rows_of(len(levels), rows, clock, first)
        if now == used:
            break
        used, kept = now, slice(*now)
        design, solution, residual = linear(clock, kept)
        if now[1] - now[0] <= design.shape[1] + 2 + (not exposure_known):
            return None
        if np.linalg.matrix_rank(design) < design.shape[1]:
            return None
        for _ in range(40):
            height = (swing @ solution[dark_degree + 1 :])[:, None]
            jacobian = np.hstack([(height * derivatives(levels, rows, clock, first))[kept], design])
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
                trial = clock + share * change
                trial[2] = max(trial[2], 1e-3)
                better = linear(trial, kept)
                if better[2] @ better[2] <= residual @ residual:
                    break
                share /= 2
            else:
                break
            moved = np.abs(trial - clock).max()
            clock, (design, solution, residual) = trial, better
            if moved < 1e-12:
                break
    assert used is not None
    variance = residual @ residual / (len(residual) - len(solution) - 2 - (not exposure_known))
    jacobian = np.hstack([((swing @ solution[dark_degree + 1 :])[:, None] * derivatives(levels, rows, clock, first))])
    jacobian = np.hstack([jacobian[kept], design])
    covariance = invert(jacobian.T @ jacobian, exposure_known)
    if covariance is None:
        return None
    return ChannelEstimate(
        float(clock[0]),
        float(clock[1]),
        float(clock[2]),
        ClockErrors(middle, variance * covariance),
        solution[: dark_degree + 1],
        solution[dark_degree + 1 :],
        float(np.sqrt(variance)),
        used,
        True,
    )


def clock_bounds(
    chips: npt.ArrayLike,
    swing: npt.ArrayLike,
    *,
    rows_per_chip: float,
    phase: float,
    exposure_rows: float,
    noise: float,
    first: int = 0,
    exposure_known: bool = False,
    dark_degree: int = 1,
    swing_degree: int = 0,
) -> ClockErrors | None:
    """Inverse of the Fisher information JT J / noise^2, J the derivatives of the rows by all unknowns."""
    levels, height = np.asarray(chips, dtype=float), np.asarray(swing, dtype=float)
    rows = len(height)
    clock = np.array([rows_per_chip, phase, max(exposure_rows, 1e-3)])
    kept = slice(*rows_of(len(levels), rows, clock, first))
    s = expose_chips(levels, rows, rows_per_chip=rows_per_chip, phase=phase, exposure_rows=exposure_rows, first=first)
    by_clock = height[:, None] * derivatives(levels, rows, clock, first)
    jacobian = np.hstack([by_clock, legendre(rows, dark_degree), legendre(rows, swing_degree) * s[:, None]])[kept]
    if len(jacobian) < jacobian.shape[1] - exposure_known:
        return None
    covariance = invert(jacobian.T @ jacobian, exposure_known)
    return None if covariance is None else ClockErrors(first + len(levels) // 2, noise**2 * covariance)


def find_preamble(
    signal: npt.ArrayLike,
    preamble: npt.ArrayLike,
    *,
    rows_per_chip: float,
    tolerance: float = 0.02,
    exposure_rows: float | None = None,
    max_exposure_chips: float = 14.0,
    max_matches: int = 1,
) -> list[PreambleMatch]:
    """The channel fitted from every chip of the frame and a grid of exposures; the surest matches that do not overlap.

    Slower than the correlation of the C++ core, and it leaves nothing out.
    """
    values, known = np.asarray(signal, dtype=float), np.asarray(preamble, dtype=float)
    rows, found = len(values), []
    lengths = [exposure_rows] if exposure_rows is not None else rows_per_chip * np.arange(0.5, max_exposure_chips + 0.5)
    for length in lengths:
        if exposure_rows is None and len(known) - length / rows_per_chip < 6:
            continue
        for start in np.arange(-length / 2, rows - len(known) * rows_per_chip + length / 2, 0.5 * rows_per_chip):
            channel = fit_channel(
                values,
                known,
                rows_per_chip=rows_per_chip,
                phase=start,
                exposure_rows=length,
                exposure_known=exposure_rows is not None,
            )
            if channel is None or channel.swing[0] <= 0 or abs(channel.rows_per_chip / rows_per_chip - 1) > 0.1:
                continue
            begin, end = channel.rows
            line = np.polynomial.polynomial.Polynomial.fit(np.arange(begin, end), values[begin:end], 1)
            squares = np.sum((values[begin:end] - line(np.arange(begin, end))) ** 2)
            explained = 1 - channel.noise**2 * (end - begin) / squares
            period = max(channel.rows_per_chip, 1.0)
            gain = -0.5 * (end - begin) / period * np.log(1 - np.clip(explained, 0, 1 - 1e-9))
            found.append(PreambleMatch(channel, float(explained), float(gain - np.log(rows / period))))
    apart: list[PreambleMatch] = []
    for match in sorted(found, key=lambda match: -match.certainty):
        near = [abs(match.channel.phase - other.channel.phase) < 0.5 * len(known) * rows_per_chip for other in apart]
        if match.certainty > 5.5 and len(apart) < max_matches and not any(near):
            apart.append(match)
    return apart


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


def refine_channel(
    signal: npt.ArrayLike,
    start: ChannelEstimate,
    detect: Detect | None = None,
    *,
    known: npt.ArrayLike = (),
    known_first: int = 0,
    exposure_known: bool = False,
    highest_degree: int = 4,
) -> RefinedChannel | None:
    """Detects and fits in turn on rows that grow by a fifth at either end, then until no chip changes.

    The simplest form of the idea: one try, no other rates, lines for the levels until all rows are in, then the degree
    that Schwarz's criterion picks.
    """
    values, given = np.asarray(signal, dtype=float), np.asarray(known, dtype=float)
    rows, channel = len(values), start
    begin, end = channel.rows
    last: tuple[int, FloatArray] | None = None
    for _ in range(60):
        growth = int(0.2 * (end - begin) + channel.rows_per_chip)
        begin, end = max(begin - growth, 0), min(end + growth, rows)
        at = np.clip(np.arange(begin, end), *channel.rows)  # levels are held beyond the rows that told them
        dark, bright = channel.levels(rows)[:, np.minimum(at, rows - 1)]
        clock = channel.rows_per_chip, channel.phase - begin, channel.exposure_rows
        first = int(np.floor((-channel.exposure_rows / 2 - clock[1]) / clock[0]))
        stop = int(np.floor((end - begin - 1 + channel.exposure_rows / 2 - clock[1]) / clock[0])) + 1
        normal = (values[begin:end] - dark) / (bright - dark)
        chips = np.asarray(
            (detect or detect_sequence)(normal, *clock, channel.noise / np.mean(bright - dark), first, stop - first)
        )
        for k, level in enumerate(given, known_first - first):
            if 0 <= k < len(chips):
                chips[k] = level
        whole = end - begin == rows
        fits = []
        for degree in range(highest_degree + 1 if whole else 1):
            fit = fit_channel(
                values,
                chips[1:-1],
                rows_per_chip=channel.rows_per_chip,
                phase=channel.phase,
                exposure_rows=channel.exposure_rows,
                first=first + 1,
                exposure_known=exposure_known,
                dark_degree=max(degree, 1),
                swing_degree=degree,
            )
            if fit is not None:
                count = fit.rows[1] - fit.rows[0]
                fits.append((2 * count * np.log(fit.noise) + 2 * degree * np.log(count), degree, fit))
        if not fits:
            return None
        channel = min(fits)[2]
        settled = whole and last is not None and last[0] == first and np.array_equal(last[1], chips)
        last = first, chips
        if settled:
            break
    assert last is not None
    return RefinedChannel(channel, last[1], last[0], settled, True)


def find_channel(
    signal: npt.ArrayLike,
    detect: Detect | None = None,
    *,
    rows_per_chip: float,
    tolerance: float = 0.02,
    exposure_rows: float | None = None,
    max_exposure_chips: float = 7.0,
    exposure_known: bool = False,
    highest_degree: int = 4,
) -> RefinedChannel | None:
    """Every start of a grid of exposures, rates and phases on the first part of the frame refined; the best stays."""
    values = np.asarray(signal, dtype=float)
    best: RefinedChannel | None = None
    lengths = (
        [exposure_rows] if exposure_rows is not None else list(rows_per_chip * np.arange(0.5, max_exposure_chips, 0.5))
    )
    for length in lengths:
        chips = 36 + length / rows_per_chip
        part = values[: int(chips * rows_per_chip)]
        ratio = length / rows_per_chip
        shrink = 1 - ratio / 3 if ratio < 1 else (1 - 1 / (3 * ratio)) / ratio
        swing = 2 * part.std() / np.sqrt(shrink)
        for rate in np.arange(-1, 1.01, 0.5) * tolerance:
            for phase in np.arange(0, 1, 0.25):
                clock = (rows_per_chip * (1 + rate), phase * rows_per_chip, length)
                errors = ClockErrors(0, np.zeros((3, 3)))
                levels = np.array([part.mean() - swing / 2]), np.array([swing])
                start = ChannelEstimate(*clock, errors, *levels, 0.05 * swing, (0, len(part)), False)
                found = None
                if swing > 0:
                    options = {"exposure_known": exposure_known, "highest_degree": highest_degree}
                    found = refine_channel(values, start, detect, **options)  # type: ignore[arg-type]
                if found and found.channel.swing[0] > 0 and (not best or found.channel.noise < best.channel.noise):
                    best = found
    return best


class ClockTracker:
    """All frames at once: phases and rates of every update against one clock, by weighted least squares.

    What the Kalman filter comes to without drift; the memory grows with every frame.
    """

    def __init__(
        self, frame_rows: float, *, frame_rows_std: float = 0.0, drift: float = 1e-6, exposure_wander: float = 1e-4
    ) -> None:
        self.frame_rows, self.frame_rows_std = frame_rows, max(frame_rows_std, 1e-9)
        self.reset()

    def reset(self) -> None:
        """Forgets everything."""
        self.seen: list[tuple[int, ChannelEstimate]] = []

    def solve(self) -> tuple[FloatArray, FloatArray]:
        """Phase of chip 0 in frame 0, rows per chip, rows per frame, exposure; and their covariance."""
        design, right = [[0.0, 0.0, 1.0]], [self.frame_rows]
        weights = [np.array([[self.frame_rows_std**-2.0]])]
        origin, period, step = self.seen[0][1].phase, self.seen[0][1].rows_per_chip, self.frame_rows
        for frame, channel in self.seen:
            frames = float(frame - self.seen[0][0])
            middle = channel.phase + channel.errors.chip * channel.rows_per_chip
            number = np.rint((middle + frames * step - origin) / period)
            design += [[1.0, number, -frames], [0.0, 1.0, 0.0]]
            right += [middle, channel.rows_per_chip]
            weights.append(np.linalg.inv(channel.errors.covariance[:2, :2]))
            x, covariance = self.least_squares(design, right, weights)
            origin, period, step = x
        lengths = np.array([channel.exposure_rows for _, channel in self.seen])
        weight = np.array([channel.errors.covariance[2, 2] for _, channel in self.seen]) ** -1.0
        whole = np.zeros((4, 4))
        whole[:3, :3], whole[3, 3] = covariance, 1 / weight.sum()
        return np.append(x, np.average(lengths, weights=weight)), whole

    def least_squares(
        self, design: list[list[float]], right: list[float], weights: list[FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Solution and covariance; one weight matrix a measurement."""
        normal, product, at = np.zeros((3, 3)), np.zeros(3), 0
        for weight in weights:
            rows = np.array(design[at : at + len(weight)])
            normal += rows.T @ weight @ rows
            product += rows.T @ weight @ np.array(right[at : at + len(weight)])
            at += len(weight)
        covariance: FloatArray = np.linalg.inv(normal).astype(float)
        return covariance @ product, covariance

    def update(self, frame: int, channel: ChannelEstimate) -> bool:
        """Keeps the channel; jumps of the clock are not looked for."""
        self.seen.append((frame, channel))
        return True

    def predict(self, frame: int) -> TrackedClock | None:
        """The clock of all updates, in a frame."""
        if not self.seen:
            return None
        (phase, period, frame_rows, exposure_rows), covariance = self.solve()
        frames = frame - self.seen[0][0]
        chip = int(np.rint((frames * frame_rows - phase) / period))
        move = np.array([[1, chip, -frames, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
        there = move @ covariance @ move.T
        begin = phase + chip * period - frames * frame_rows
        return TrackedClock(period, begin, exposure_rows, chip, there, float(np.sqrt(there[0, 0])) / period)
