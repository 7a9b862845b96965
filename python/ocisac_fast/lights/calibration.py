"""The row time of a camera from a lamp of known frequency, and the colour that shows a lamp best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import as_columns
from ocisac_fast.core.checks import checked
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.results import Result
from ocisac_fast.tones.frequency import FoundFrequency, found_of


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class Calibration(Result):
    """A row time measured with a light of known frequency.

    Attributes:
        row_time: T_r in seconds.
        row_time_std: its standard error in seconds, for an exact frequency.
        found: the estimated tone, in cycles per row.
        flags: those of ``found``.
        probability: of the light, as of :class:`LightSource`; NaN where a tone explains the whole frame, or where no
            light was found.
    """

    row_time: float
    row_time_std: float
    found: FoundFrequency
    flags: Flag
    probability: float


@checked
def calibrate(
    columns: npt.ArrayLike,
    frequency: float,
    *,
    bounds: tuple[float, float] | None = None,
    waveform: str = "auto",
    select: bool = True,
    scan_axis: Literal["y", "-y", "x", "-x"] = "y",
) -> Calibration:
    """Estimate the row time from a light of known frequency: T_r = (cycles per row) / frequency.

    A tone that explains the whole frame is used as :func:`find_frequency` finds it. Otherwise the frequency is that of
    the light, among those that :func:`detect_sources` finds, whose swing has the largest energy: the outline of a lamp,
    text and drawn lines bias a tone over the whole frame. ``MODEL_MISFIT`` is set where light and whole frame disagree,
    where a light of a probability below 0.5, or data, is in a frame without a tone, where it is in
    less than a hundredth of the columns, as text is, where a tone that explains a part of the frame, or less than three
    cycles of it, is no light (it may be an outline), and where a frame would last longer than a second (a frequency in
    kHz for one in Hz) or a row less than 0.1 µs.

    Args:
        columns: as for :func:`find_frequency`; the columns that show the light are selected among them.
        frequency: of the light, Hz, above 0 and below half the row rate.
        bounds: shortest and longest row time, seconds; None: two cycles or more in the frame, one to two only where no
            tone and no light is found there (the outline of a lamp resembles one cycle).
        waveform: as for :func:`find_frequency`.
        select: as for :func:`find_frequency`.
        scan_axis: direction of the read-out, as in :class:`ocisac_fast.Camera`.

    Returns:
        The row time with its standard error; flags mark unreliable results.
    """
    array = as_columns(columns, scan_axis=scan_axis)
    frequency = float(frequency)
    per_row = None if bounds is None else (float(bounds[0]) * frequency, float(bounds[1]) * frequency)
    row_time, row_time_std, values, probability = _core.calibrate(array, frequency, per_row, waveform, select)
    found = found_of(values, 1.0)
    return Calibration(row_time, row_time_std, found, found.flags, probability)


@checked
def pick_colour(
    colours: Sequence[npt.ArrayLike],
    camera: Camera,
    *,
    bounds: tuple[float, float] | None = None,
    waveform: str = "auto",
) -> int:
    """Index of the picture, among several of one scene (such as its colours), that shows a tone best.

    Args:
        colours: one or more arrays as for :func:`find_frequency`. For a picture of shape (rows, columns, colours):
            ``np.moveaxis(picture, -1, 0)``.
        camera: as for :func:`find_frequency`.
        bounds: as for :func:`find_frequency`.
        waveform: as for :func:`find_frequency`.

    Returns:
        The index of the colour whose tone has the largest signal-to-noise ratio, searched as in :func:`calibrate`;
        colours flagged ``FEW_CYCLES``, ``AT_BOUND`` or ``MODEL_MISFIT`` come last; 0 if none shows a tone.
    """
    arrays = [as_columns(colour, name="colours", scan_axis=camera.scan_axis) for colour in colours]
    return _core.pick_colour(arrays, camera._handle, bounds, waveform)
