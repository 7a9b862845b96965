"""Estimation of the frequency of a periodic light."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import as_columns
from ocisac_fast.core.checks import checked
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.results import Result

# Cycles per row, standard error, signal-to-noise ratio, highest harmonic, flags, (used, strength, saturated).
CoreFound = tuple[float, float, float, int, int, tuple[npt.NDArray[np.bool_], npt.NDArray[np.float64], bool], bool]


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class ToneColumns(Result):
    """Selection of the columns that show a periodic light.

    Attributes:
        used: (columns,) bool, True if the column is selected.
        strength: (columns,) periodic share of the column's variation, 0 to 1; columns that were summed share one value.
        saturated: True if more than a tenth of the pixels of the selected columns are saturated and no better columns
            exist.
    """

    used: npt.NDArray[np.bool_]
    strength: npt.NDArray[np.float64]
    saturated: bool


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class FoundFrequency(Result):
    """A frequency estimated from the rows, common to all columns and frames.

    Attributes:
        frequency: Hz; cycles per row where the camera has no row time.
        frequency_std: its standard error in Hz, from the residual (see :func:`find_frequency`).
        cycles_per_row: ``frequency * camera.row_period``, at most 0.5.
        cycles_per_row_std: its standard error.
        snr: power of the periodic part over the power of the residual, in the fitted sums of columns.
        harmonics: number of the highest harmonic in the fit; 1 for the fundamental alone.
        columns: the selected columns, and the strength of the tone in each.
        flags: ``NO_TONE`` (no periodic component exceeds the noise: the best candidate, or NaN without variation or
            with fewer than 8 rows), ``FEW_CYCLES`` (less than two in the frame: gradients and harmonics resemble parts
            of the tone, an error that the standard error excludes), ``AT_BOUND``, ``SATURATED`` (more than a tenth of
            the selected pixels, and no better columns exist), ``MODEL_MISFIT`` (half or a third of the frequency shows
            as well, with less than half of the amplitude: it may be the fundamental; or a stronger tone, of which this
            one is the second or third harmonic, folded at half the row rate; or the phase jumps along the rows,
            as where rows are lost or repeated; or the columns show as many phases as a chessboard, a cloth or lamps of
            different phases; or it has four rows, or two, as rows of two exposures in turns; or ``may_be_texture``).
        may_be_texture: the tone hardly exceeds the texture that the spectrum shows beside it, or stands still in all
            frames.
    """

    frequency: float
    frequency_std: float
    cycles_per_row: float
    cycles_per_row_std: float
    snr: float
    harmonics: int
    columns: ToneColumns
    flags: Flag
    may_be_texture: bool


@checked
def find_frequency(
    columns: npt.ArrayLike,
    camera: Camera,
    *,
    bounds: tuple[float, float] | None = None,
    waveform: str = "auto",
    select: bool = True,
) -> FoundFrequency:
    """Estimate the frequency of a periodic light to a small fraction of a bin of the spectrum.

    The strongest lines of the spectrum (OpenCV's DFT) and a grid over the first four cycles are candidates. The
    candidate whose tone and first harmonics explain the columns best is the fundamental; least squares refine it by

        y_k(n) = trend_k(n) + sum_h [a_kh cos(2 pi h f T_r n) + b_kh sin(2 pi h f T_r n)]

    over all columns k with one f. The trend is a constant below 2 cycles in the frame, a line below 4, else a
    parabola. Frames wider than 64 columns are first summed in up to 64 groups of neighbours. Stored values are not
    linearised, since a tone curve preserves the period. Where a frame has less than two cycles, or no tone, and the
    camera has a frame time, the changes from frame to frame tell the frequency of four frames or more.

    The standard error comes from the residual and allows noise that neighbouring columns share, that grows with the
    light, that is correlated from row to row (speckle, text), or that is texture of the scene, and for rounding, of
    which rows of one phase see the same. In white noise the error of f is at the Cramer-Rao bound of the model above.

    Args:
        columns: (rows,), (rows, columns) or (frames, rows, columns), rows in time order, all of one light; the phase
            may differ between frames. Finite.
        camera: its row time sets the unit; without one, frequencies are in cycles per row.
        bounds: lowest and highest frequency of the search, Hz. By default from one cycle in the frame to half the row
            rate; a tone above that is found at its alias.
        waveform: ``"auto"`` fits the harmonics that exceed the noise, ``"tone"`` the fundamental alone,
            ``"square"`` all harmonics below half the row rate; at most 31.
        select: use only the columns that show the light (:func:`tone_columns`).

    Returns:
        The frequency with its standard error; flags mark unreliable results.

    Raises:
        ValueError: wrong shape or type, samples that are not finite, bounds that are not 0 <= low < high with low below
            half the row rate, or an unknown waveform.
    """
    array = as_columns(columns, scan_axis=camera.scan_axis)
    found = found_of(_core.find_frequency(array, camera._handle, bounds, waveform, select), camera.row_period)
    few = Flag.FEW_CYCLES | Flag.AT_BOUND | Flag.NO_TONE
    times = camera.frame_time is not None and camera.row_time is not None and bounds is None
    if times and found.flags & few and array.ndim == 3 and len(array) >= _FEWEST_FRAMES:
        return _over_frames(array, camera.in_time_order, found)
    return found


def found_of(values: CoreFound, row_period: float) -> FoundFrequency:
    """Convert the core's values."""
    cycles, cycles_std, snr, harmonics, flags, (used, strength, saturated), may_be_texture = values
    return FoundFrequency(
        frequency=cycles / row_period,
        frequency_std=cycles_std / row_period,
        cycles_per_row=cycles,
        cycles_per_row_std=cycles_std,
        snr=snr,
        harmonics=harmonics,
        columns=ToneColumns(used, strength, saturated),
        flags=Flag(flags),
        may_be_texture=may_be_texture,
    )


@checked
def tone_columns(columns: npt.ArrayLike, camera: Camera, frequency: float | None = None) -> ToneColumns:
    """Select the columns that show a periodic light, without text, boxes, dark and saturated areas.

    A column is selected if its ratio of periodic to other energy (without a slow trend; fundamental and two harmonics)
    is at least a tenth of the best. If columns with at most a tenth of saturated pixels reach that, only those are
    selected. Frames wider than 64 columns are evaluated in up to 64 groups of neighbours.

    Args:
        columns: as for :func:`find_frequency`.
        camera: row time, tone curve and levels.
        frequency: of the light in Hz, above 0; None: estimated first.
    """
    if frequency is None:
        return find_frequency(columns, camera).columns
    return ToneColumns(*_core.tone_columns(as_columns(columns, scan_axis=camera.scan_axis), camera._handle, frequency))


_SEEN_FRAMES = 64  # together, at most
_FEWEST_FRAMES = 4
_EXPLAINED = 0.3  # share of what changes from frame to frame
_CHANCE = 0.01
_APART = 0.2  # of the largest: another frequency that explains more leaves doubt
_MOST_TURNS = 1 << 24  # of all frequencies that are searched in all rows: frames further apart tell none


def _over_frames(frames: npt.NDArray[np.generic], camera: Camera, found: FoundFrequency) -> FoundFrequency:
    """Frequency of what changes from frame to frame, of less than four cycles a frame; ``found`` where nothing does.

    What stands still is fitted with the light, one tone at the times j T_f + n T_r of all rows. The standard error is
    that of the jackknife over (up to 16 groups of) frames: textures under the light are no white residual.
    """
    assert camera.frame_time is not None
    light = np.asarray(frames[:_SEEN_FRAMES], np.float64).mean(axis=2)
    count, rows = light.shape
    of_frame, of_row = np.arange(count) * camera.frame_time, np.arange(rows) * camera.row_period
    lasts = count * camera.frame_time
    highest = min(4.0 / (rows * camera.row_period), 0.25 / camera.row_period)
    changes = light - light.mean(axis=0)
    if not changes.any() or 10.0 * highest * lasts * (rows + count) > _MOST_TURNS:
        return found
    largest = np.abs(changes).max()
    light, changes = light / largest, changes / largest  # squares of tiny ones are 0
    grid = np.arange(2.0 / lasts, highest, 0.1 / lasts)
    if grid.size == 0:
        return found
    turns = np.exp(-2j * np.pi * np.outer(grid, of_frame))
    lines = ((np.exp(-2j * np.pi * np.outer(grid, of_row)) @ changes.T) * turns).sum(axis=1)
    seen = 1.0 - np.abs(turns.mean(axis=1)) ** 2  # of a tone's energy, beside the mean over the frames
    power = np.where(seen > 0.5, np.abs(lines) ** 2 / np.maximum(seen, 0.5), 0.0)
    best = int(power.argmax())
    others = power[np.abs(grid - grid[best]) > 1.5 / lasts]
    if others.max(initial=0.0) >= (1.0 - _APART) * power[best]:
        return found

    def refined(kept: npt.NDArray[np.intp]) -> tuple[float, float]:
        """Frequency in some frames, and the share of their changes that it explains."""
        own = light[kept] - light[kept].mean(axis=0)
        places = grid[best] + np.linspace(-0.5, 0.5, 21) / lasts
        shares = np.empty(places.size)
        for place, frequency in enumerate(places):
            wave = np.exp(2j * np.pi * frequency * (of_frame[kept, None] + of_row))
            wave = wave - wave.mean(axis=0)
            parts = np.stack([wave.real.ravel(), wave.imag.ravel()])
            products = (parts * own.ravel()).sum(axis=1)
            gram = np.array([[(one * other).sum() for other in parts] for one in parts])
            shares[place] = products @ np.linalg.lstsq(gram, products)[0] / (own**2).sum()  # sines may be all 0
        top = min(max(int(shares.argmax()), 1), places.size - 2)
        low, middle, high = shares[top - 1 : top + 2]
        bend = low - 2.0 * middle + high
        step = 0.5 * (low - high) / bend if bend < 0.0 else 0.0
        return float(places[top] + step * (places[1] - places[0])), float(middle)

    every = np.arange(count)
    frequency, share = refined(every)
    chance = grid.size * max(1.0 - share, 0.0) ** (0.5 * (changes.size - rows) - 1.0)  # of noise that few rows show
    if share < _EXPLAINED or chance > _CHANCE:
        return found
    groups = min(count, 16)
    without = [refined(every[every * groups // count != group])[0] for group in range(groups)]
    std = math.sqrt((groups - 1) * float(np.var(without)))
    cycles = camera.row_period
    return replace(
        found,
        frequency=frequency,
        frequency_std=std,
        cycles_per_row=frequency * cycles,
        cycles_per_row_std=std * cycles,
        snr=share / max(1.0 - share, 1e-12),
        harmonics=1,
        columns=replace(found.columns, used=np.ones_like(found.columns.used)),
        flags=found.flags & Flag.SATURATED,
        may_be_texture=False,
    )
