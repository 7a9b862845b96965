"""Estimation of the frequency of a periodic light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import as_columns
from ocisac_fast.core.checks import checked
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.results import Result

# Cycles per row, standard error, signal-to-noise ratio, highest harmonic, flags, (used, strength, saturated).
CoreFound = tuple[float, float, float, int, int, tuple[npt.NDArray[np.bool_], npt.NDArray[np.float64], bool]]


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
            as well, with less than half of the amplitude: it may be the fundamental).
    """

    frequency: float
    frequency_std: float
    cycles_per_row: float
    cycles_per_row_std: float
    snr: float
    harmonics: int
    columns: ToneColumns
    flags: Flag


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
    linearised, since a tone curve preserves the period.

    The standard error comes from the residual and allows noise that neighbouring columns share, that grows with the
    light, or that is correlated from row to row (speckle, text). In white noise the error of f is at the Cramer-Rao
    bound of the model above.

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
    return found_of(_core.find_frequency(array, camera._handle, bounds, waveform, select), camera.row_period)


def found_of(values: CoreFound, row_period: float) -> FoundFrequency:
    """Convert the core's values."""
    cycles, cycles_std, snr, harmonics, flags, (used, strength, saturated) = values
    return FoundFrequency(
        frequency=cycles / row_period,
        frequency_std=cycles_std / row_period,
        cycles_per_row=cycles,
        cycles_per_row_std=cycles_std,
        snr=snr,
        harmonics=harmonics,
        columns=ToneColumns(used, strength, saturated),
        flags=Flag(flags),
    )


@checked
def tone_columns(columns: npt.ArrayLike, camera: Camera, frequency: float | None = None) -> ToneColumns:
    """Select the columns that show a periodic light, without text, boxes, dark and saturated areas.

    A column is selected if its ratio of periodic to other energy (without a slow trend; fundamental and two harmonics)
    is at least an eighth of the best. If columns with at most a tenth of saturated pixels reach that, only those are
    selected. Frames wider than 64 columns are evaluated in up to 64 groups of neighbours.

    Args:
        columns: as for :func:`find_frequency`.
        camera: row time, tone curve and levels.
        frequency: of the light in Hz, above 0; None: estimated first.

    Raises:
        ValueError: as for :func:`find_frequency`, or a frequency that is not finite and above 0.
    """
    if frequency is None:
        return find_frequency(columns, camera).columns
    return ToneColumns(*_core.tone_columns(as_columns(columns, scan_axis=camera.scan_axis), camera._handle, frequency))
