"""Row time, exposure and pulse width from a lamp that is lit about once a frame.

Such a lamp shows a band of lit rows. At half height the band is (t_on + offset) / T_r rows long, t_on = duty / f. The
offset combines exposure, tone curve and the lamp's rise and fall, and is equal for all duties. Several duties separate
row time and offset; one recording does not. Where a pulse ends and the next begins in one frame of N rows, the lit rows
at its ends add up to (t_on + offset - 1/f) / T_r + N, so that both kinds of frames give the lamp's period in rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import Positive, checked
from ocisac_fast.core.results import Result

_DARK_SHARE = 5.0  # percentile over the frames that estimates the dark level
_PLATEAU_SHARE = 90.0  # percentile of lit samples, on the plateau of pulses that are longer than the exposure
_MIN_LIGHT = 0.05  # of the brightest row; darker rows are ignored
_MAX_NOISE = 0.1  # of a row's swing; noisier rows are ignored
_SURE = 0.25  # rows within it of half height are neither dark nor lit
_MAX_DEVIATION = 3.0  # standard errors
_MIN_PULSES = 5
_MIN_SPREAD = 0.05  # rows
_NORMAL_MAD = 1.4826  # standard deviation of a normal distribution over its median absolute deviation
_REACH = 12  # rows of a ramp on either side of its middle
_BOX_ROWS = np.arange(0.0, 20.01, 0.25)
_BLUR_ROWS = np.concatenate([[1e-3], np.arange(0.1, 4.01, 0.1)])
_MAX_MISFIT = 0.1  # of a ramp, of a level, of the rows
_erf = np.vectorize(math.erf, otypes=[float])


@dataclass(frozen=True, slots=True, repr=False)
class PulseBands(Result):
    """The bands of one recording.

    Attributes:
        whole: (bands,) lit rows at half height of bands within a frame.
        split: (frames,) lit rows of frames that begin and end lit, with one dark interval in between.
        row_count: rows of a frame that the lamp lights.
        ramps: (ramps, points) light at -12 .. 12 rows from half height into a band, steps of 1/2; 0 to 1.
        levels: (rows,) linear light of each lit row above its dark one; NaN in rows beside the lamp.
    """

    whole: Float64s
    split: Float64s
    row_count: int
    ramps: Float64s
    levels: Float64s

    @property
    def period_rows(self) -> tuple[float, float]:
        """Period of the lamp in rows and its standard error, whatever duty and offset; NaN unless both kinds are seen.

        The error is the scatter of bands, as that of :func:`calibrate_pulses`.
        """
        if min(self.whole.size, self.split.size) < _MIN_PULSES:
            return math.nan, math.nan
        period = self.row_count + float(self.whole.mean() - self.split.mean())
        return period, math.hypot(_spread(self.whole), _spread(self.split))


@dataclass(frozen=True, slots=True, repr=False)
class PulseCalibration(Result):
    """Result of :func:`calibrate_pulses`.

    Attributes:
        row_time, row_time_std: s. From one duty, the error includes the unknown offset; with "period_misfit", the
            difference from 1 / (frequency period_rows).
        period_rows, period_rows_std: period of the lamp, from lit and dark rows alone; NaN without split bands.
        offset, offset_std: of bands within a frame, T_e + c in s; NaN from one duty or without such bands.
        exposure, exposure_std: length of the ramps as a box blurred by a Gaussian, s; NaN from 20 rows on.
        blur: standard deviation of the Gaussian in rows: lens, scaling and compression.
        misfit: largest difference between a mean ramp and the fit, relative to the swing.
        rows: (recordings,) lit rows at half height; NaN if no pulse was within a frame.
        pulse_widths: (recordings,) rows * row_time - offset in s: the measured t_on.
        bands: of each recording.
        flags: "one_duty": the row time is that without an offset; "model_misfit": the ramps do not fit a lamp's edges;
            "period_misfit": ``period_rows`` of this row time are not 1/frequency, so that the duties are off;
            "short_pulses": a tenth of the rows or more are darker by a tenth or more in one recording than in another:
            pulses shorter than the exposure, whose bands do not follow the duty, or too few frames.
    """

    row_time: float
    row_time_std: float
    period_rows: float
    period_rows_std: float
    offset: float
    offset_std: float
    exposure: float
    exposure_std: float
    blur: float
    misfit: float
    rows: Float64s
    pulse_widths: Float64s
    bands: tuple[PulseBands, ...]
    flags: tuple[str, ...]


@checked
def pulse_bands(light: npt.ArrayLike) -> PulseBands:
    """Measure the lit rows in a recording of a lamp whose pulses are longer than the exposure.

    Args:
        light: (frames, rows) linear light of each row, the mean over columns. Each row is lit in some frames and dark
            in at least 5 % of them.

    Raises:
        ValueError: a wrong shape, values that are not finite, or no row that changes.
    """
    signal = np.asarray(light, dtype=np.float64)
    if signal.ndim != 2 or min(signal.shape) < 2 or not np.all(np.isfinite(signal)):
        raise ValueError(f"light: got shape {signal.shape}, allowed: (frames, rows), two of each at least, finite")
    share, levels = _lit_share(signal)
    whole: list[float] = []
    split: list[float] = []
    ramps: list[Float64s] = []
    for row in share:
        rises, falls = _edges(row)
        for begin, end in _pairs(rises, falls):
            if begin > _REACH and end < row.size - 1 - _REACH:
                whole.append(end - begin)
                ramps += [_ramp(row, begin, 1.0), _ramp(row, end, -1.0)]
        if not np.isnan(levels).any() and falls.size == 1 and rises.size == 1 and rises[0] - falls[0] > 2 * _REACH:
            split.append(row.size - (rises[0] - falls[0]))
    points = 4 * _REACH + 1
    return PulseBands(
        np.array(whole), np.array(split), signal.shape[1], np.reshape(ramps, (len(ramps), points)), levels
    )


@checked
def calibrate_pulses(
    recordings: Sequence[npt.ArrayLike | PulseBands], frequency: Positive, duties: Sequence[float]
) -> PulseCalibration:
    """Estimate row time, exposure and pulse width from a lamp lit about once a frame, jointly from several duties.

    Args:
        recordings: of the same camera, lamp, exposure and gain, each (frames, rows) or the result of
            :func:`pulse_bands`; pulses are longer than the exposure.
        frequency: of the lamp in Hz, above 0.
        duties: lit share of the period of each recording, above 0 and below 1.

    Returns:
        :class:`PulseCalibration`. Standard errors equate the error of a recording's mean with the scatter of its bands,
        which is systematic (it depends on the place in the picture), not noise.

    Raises:
        ValueError: an argument outside its range, no pulses, or only split ones at a single duty.
    """
    _check(recordings, duties)
    bands = tuple(each if isinstance(each, PulseBands) else pulse_bands(each) for each in recordings)
    points = _points(bands, np.asarray(duties, dtype=np.float64) / frequency)
    ramp = _fitted_ramp([one.ramps for one in bands if one.ramps.size])
    jointly = any(np.unique(points.times[points.kinds == kind]).size > 1 for kind in (0, 1))
    row_time, row_time_std, offset, offset_std = _joint_fit(points) if jointly else _single_fit(points, ramp.reach)
    period, period_std = _mean_period(bands)
    off = 1.0 / (frequency * period) - row_time
    off_std = math.hypot(row_time_std, period_std / (frequency * period**2))
    is_off = jointly and abs(off) > _MAX_DEVIATION * off_std
    if is_off:
        row_time_std = math.hypot(row_time_std, off)
    seen = np.array([one.whole.mean() if one.whole.size >= _MIN_PULSES else math.nan for one in bands])
    exposure_std = math.hypot(ramp.box_std * row_time, ramp.box * row_time_std)
    named = {
        "one_duty": not jointly,
        "model_misfit": ramp.misfit > _MAX_MISFIT,
        "period_misfit": is_off,
        "short_pulses": _has_short_pulses(bands),
    }
    return PulseCalibration(
        *(row_time, row_time_std, period, period_std, offset, offset_std),
        *(ramp.box * row_time, exposure_std, ramp.blur, ramp.misfit),
        rows=seen,
        pulse_widths=seen * row_time - offset,
        bands=bands,
        flags=tuple(name for name, holds in named.items() if holds),
    )


def box_ramp(offsets: npt.ArrayLike, box: float, blur: float) -> Float64s:
    """Light at rows from half height into a band: a box of ``box`` rows blurred by a Gaussian of ``blur`` rows."""
    return np.asarray(_box_ramps(np.asarray(offsets, dtype=np.float64), np.array([box]), np.array([blur]))[0])


def _mean_period(bands: Sequence[PulseBands]) -> tuple[float, float]:
    """Mean of the recordings' periods in rows; its error is not reduced, since it is systematic."""
    found = np.array([one.period_rows for one in bands])
    found = found[np.isfinite(found[:, 0])]
    return (float(found[:, 0].mean()), float(found[:, 1].mean())) if found.size else (math.nan, math.nan)


def _has_short_pulses(bands: Sequence[PulseBands]) -> bool:
    """A pulse shorter than the exposure is darker than a longer one, in all rows alike."""
    if len({one.levels.size for one in bands}) > 1:
        return False
    levels = np.array([one.levels for one in bands])
    levels = levels[:, np.isfinite(levels).all(axis=0)]
    darker = levels < (1.0 - _MAX_MISFIT) * levels.max(axis=0)
    return bool(levels.size) and bool((darker.mean(axis=1) > _MAX_MISFIT).any())


def _spread(rows: Float64s) -> float:
    return max(float(np.std(rows)), _MIN_SPREAD)


class _Points(NamedTuple):
    """Lit rows of the recordings' whole (kind 0) and split (kind 1) bands."""

    times: Float64s  # t_on, s
    rows: Float64s
    spreads: Float64s
    kinds: npt.NDArray[np.int_]


def _check(recordings: Sequence[object], duties: Sequence[float]) -> None:
    if len(recordings) != len(duties) or len(recordings) == 0:
        raise ValueError(f"duties: got {len(duties)}, allowed: one for each of {len(recordings)} recordings")
    for duty in duties:
        if not 0.0 < duty < 1.0:
            raise ValueError(f"duties: got {duty}, allowed: above 0 and below 1")


def _points(bands: Sequence[PulseBands], lit: Float64s) -> _Points:
    points = [
        (time, np.mean(some), _spread(some), kind)
        for one, time in zip(bands, lit, strict=True)
        for kind, some in enumerate((one.whole, one.split))
        if some.size >= _MIN_PULSES
    ]
    if not points:
        raise ValueError("recordings: got no lit band with both ends in sight, allowed: pulses of a part of a frame")
    return _Points(*(np.array(column) for column in zip(*points, strict=True)))


def _lit_share(signal: Float64s) -> tuple[Float64s, Float64s]:
    """Light of each row from 0 (dark) to 1 (lit) in the longest run of bright rows, and its level when lit."""
    low, top = np.percentile(signal, _DARK_SHARE, axis=0), signal.max(axis=0)
    if not (top - low).max() > 0.0:
        raise ValueError("light: got rows that do not change, allowed: a lamp that is lit in some frames")
    above = signal > 0.5 * (low + top)
    below, lit = np.where(above, np.nan, signal), np.where(above | (top <= low), signal, np.nan)
    noise = _NORMAL_MAD * np.nanmedian(np.abs(below - np.nanmedian(below, axis=0)), axis=0)
    dark, full = -_plateau(-below, noise), _plateau(lit, noise)
    full -= dark
    bright = np.concatenate([[False], (full > _MIN_LIGHT * full.max()) & (noise < _MAX_NOISE * full), [False]])
    edges = np.flatnonzero(np.diff(bright))
    if edges.size == 0:
        raise ValueError("light: got noise above a tenth of the lamp's light, allowed: less (more columns)")
    longest = np.argmax(edges[1::2] - edges[::2])
    first, last = edges[2 * longest], edges[2 * longest + 1]
    share = (signal[:, first:last] - dark[first:last]) / full[first:last]
    levels = np.full(signal.shape[1], np.nan)
    levels[first:last] = full[first:last]
    return share, levels


def _plateau(signal: Float64s, noise: Float64s) -> Float64s:
    """Level of each row's brightest samples, without the ramps of pulses, which are many if pulses are short."""
    high = np.nanpercentile(signal, _PLATEAU_SHARE, axis=0)
    least = high - np.maximum(4.0 * noise, 0.05 * (high - np.nanmin(signal, axis=0)))
    return np.asarray(np.nanmedian(np.where(signal >= least, signal, np.nan), axis=0))


def _edges(row: Float64s) -> tuple[Float64s, Float64s]:
    """Positions, between rows, of rises and of falls through 1/2, each between a dark and a lit row."""
    sure = np.flatnonzero(np.abs(row - 0.5) > _SURE)
    lit = row[sure] > 0.5
    turns = np.flatnonzero(lit[1:] != lit[:-1])
    places = np.array([_half_height(row, sure[turn], sure[turn + 1]) for turn in turns])
    rising = lit[turns + 1]
    return places[rising], places[~rising]


def _half_height(row: Float64s, first: int, last: int) -> float:
    """Median of the crossings of 1/2, of which noise makes several."""
    part = row[first : last + 1] - 0.5
    crossed = np.flatnonzero((part[:-1] > 0.0) != (part[1:] > 0.0))
    return float(first + np.median(crossed + part[crossed] / (part[crossed] - part[crossed + 1])))


def _pairs(rises: Float64s, falls: Float64s) -> Iterator[tuple[float, float]]:
    """Begin and end of bands that begin within the frame and end in it."""
    ends = falls[np.searchsorted(falls, rises[0]) :] if rises.size else falls[:0]
    return zip(rises.tolist(), ends.tolist(), strict=False)


def _ramp(row: Float64s, middle: float, direction: float) -> Float64s:
    offsets = np.linspace(-_REACH, _REACH, 4 * _REACH + 1)
    return np.interp(middle + direction * offsets, np.arange(row.size), row)


@dataclass(frozen=True, slots=True)
class _Ramp:
    box: float  # rows
    box_std: float
    blur: float
    misfit: float
    reach: float  # rows from 0 to 1


def _fitted_ramp(ramps: Sequence[Float64s]) -> _Ramp:
    """Fit a box and a Gaussian to the mean of the recordings' median ramps; the error is the scatter of these."""
    if not ramps:
        return _Ramp(math.nan, math.nan, math.nan, math.nan, math.nan)
    middles = [np.median(each[side::2], axis=0) for each in ramps for side in (0, 1)]
    mean = np.mean(middles, axis=0)
    offsets = np.linspace(-_REACH, _REACH, mean.size)
    box, blur = np.meshgrid(_BOX_ROWS, _BLUR_ROWS, indexing="ij")
    models = _box_ramps(offsets, box.ravel(), blur.ravel())
    each = [int(np.sum((models - one) ** 2, axis=1).argmin()) for one in (mean, *middles)]
    boxes = box.ravel()[each]
    seen = float(boxes[0]) if boxes[0] < _BOX_ROWS[-1] else math.nan
    reach = float(np.interp(0.9, mean, offsets) - np.interp(0.1, mean, offsets)) / 0.8
    misfit = float(np.abs(models[each[0]] - mean).max())
    spread = float(np.std(boxes[1:])) + 0.25 if math.isfinite(seen) else math.nan
    return _Ramp(seen, spread, float(blur.ravel()[each[0]]), misfit, reach)


def _box_ramps(offsets: Float64s, box: Float64s, blur: Float64s) -> Float64s:
    """(ramps, offsets): the integral of a box of ``box`` rows blurred by a Gaussian of ``blur`` rows."""
    length, width = np.maximum(box, 1e-3)[:, np.newaxis], blur[:, np.newaxis]

    def integral(at: Float64s) -> Float64s:
        z = at / width
        bell = np.exp(-0.5 * z * z) / math.sqrt(math.tau)
        return np.asarray(0.5 * at * (1.0 + _erf(z / math.sqrt(2.0))) + width * bell)

    return np.asarray((integral(offsets + 0.5 * length) - integral(offsets - 0.5 * length)) / length)


def _joint_fit(points: _Points) -> tuple[float, float, float, float]:
    """Weighted least squares of rows = times / T_r + a for whole bands or + b for split ones."""
    times, rows, spreads, kinds = points
    present = [kind for kind in (0, 1) if np.any(kinds == kind)]
    model = np.column_stack([times, *(kinds == kind for kind in present)]) / spreads[:, np.newaxis]
    inverse = np.linalg.inv(model.T @ model)
    slope, *constants = inverse @ model.T @ (rows / spreads)
    if not slope > _MAX_DEVIATION * math.sqrt(inverse[0, 0]):
        raise ValueError(f"duties: got {np.round(rows, 1)} lit rows, allowed: rows that increase with the duty")
    row_time = 1.0 / slope
    row_time_std = math.sqrt(inverse[0, 0]) * row_time**2
    if present[0] != 0:
        return row_time, row_time_std, math.nan, math.nan
    gradient = np.array([-constants[0] * row_time**2, row_time])  # derivatives of a * T_r by slope and a
    return row_time, row_time_std, constants[0] * row_time, math.sqrt(gradient @ inverse[:2, :2] @ gradient)


def _single_fit(points: _Points, reach: float) -> tuple[float, float, float, float]:
    """Estimate T_r as t_on / rows with the offset 0.

    The error is twice the length of a ramp: a light that saturates at the share c of its peak has ramps of c T_e and an
    offset of (1 - c) T_e.
    """
    times, rows, spreads, kinds = points
    whole = kinds == 0
    if not np.any(whole):
        raise ValueError("recordings: got pulses split across frames at one duty, allowed: two duties or whole pulses")
    seen = float(rows[whole].mean())
    row_time = float(times[whole][0]) / seen
    return row_time, row_time * math.hypot(2.0 * reach, float(spreads[whole].max())) / seen, math.nan, math.nan
