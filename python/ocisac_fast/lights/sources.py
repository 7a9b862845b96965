"""Detection of every modulated light in a picture: box, frequency, and whether it carries data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import as_grey_frames, stored_box
from ocisac_fast.core.checks import Count, Within, checked
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.regions import Region
from ocisac_fast.core.results import Result


@dataclass(frozen=True, slots=True, repr=False)
class LightSource(Result):
    """A modulated light in one frame.

    Attributes:
        frame: index of the frame.
        x, y: top left corner of its box, pixels as stored.
        width, height: of its box, pixels as stored: where the swing is above 15 % of its maximum. For a light in
            several parts, the box contains all of them and the other values are those of the strongest part.
        probability: that it is a light and no texture, from its frame and the phases in neighbouring frames.
        frequency: Hz, below half the row rate; that of the strongest tone for a light that carries data.
        frequency_std: its standard error, Hz.
        gain, gain_std: of the light in the box, as in :func:`tone_gain`, without subtraction of a background.
        phase: of the fundamental at the end of row 0's exposure, rad, as in :func:`tone_gain`.
        mean: light in the box, DN above dark.
        snr: power ratio of the periodic swing to the residual in the logarithm of the light: texture and other light
            count as noise. For data detected by their waveform: of all common swing.
        amplitude: of the fundamental where it is brightest, DN; its root mean square for data detected by waveform.
        periodic: periodic share of the swing common to all columns; 0 for data detected by their waveform.
        carries_data: ``periodic`` is below 0.7, or no tone is common to all parts: not a tone or a square wave.
        reflection_of: index in the list of the frame's lights of the stronger light that this one reflects, or None.
        reason: criterion of the reflection ("frequency and phase", or "frequency" where too many rows lie between the
            two to compare phases) or of merged detections ("overlap"; "waveform": neighbouring parts, and the region
            between, have the same swing); "" for a light detected once.
        merged: number of detections of the same light that were merged into it.
        flags: :class:`ocisac_fast.Flag` of the gain.
    """

    frame: int
    x: int
    y: int
    width: int
    height: int
    probability: float
    frequency: float
    frequency_std: float
    gain: float
    gain_std: float
    phase: float
    mean: float
    snr: float
    amplitude: float
    periodic: float
    carries_data: bool
    reflection_of: int | None
    reason: str
    merged: int
    flags: Flag

    @property
    def region(self) -> Region:
        """Its box."""
        return Region(self.x, self.y, self.width, self.height)


@checked
def detect_sources(
    frames: npt.ArrayLike,
    camera: Camera,
    *,
    false_alarms: float = 0.01,
    min_cycles: float = 2.5,
    max_sources: Count = 64,
    frame: Annotated[int, Within(0)] | None = None,
) -> list[LightSource]:
    """Detect every modulated light in a picture, frame by frame.

    A light multiplies a picture: p(row, column) = light(row) picture(row, column), so the logarithms of neighbouring
    columns have the same swing about their own means. Tiles of 32 rows and three groups of columns at several scales
    are screened for a tone common to the groups. Demodulation gives the box of each detection; the frequency maximises
    the energy of f, 2f and 3f in log light weighted by the local swing. A detection without a tone is a light that
    carries data if all its columns have one waveform with more edges and a better clock than a picture has.

    Args:
        frames: (rows, columns) or (frames, rows, columns), rows in time order, DN; nothing is detected in fewer than
            32 rows.
        camera: row time; exposure, tone curve, dark and white level where known.
        false_alarms: upper bound of the expected number of false lights in a picture without lights, above 0 up to 1,
            on overlapping boxes of 720 x 960 pixels, the most critical texture; noise, clouds and text give fewer. It
            sets the ``probability`` required: 0.72 at 0.02, more below. Photographs of regular things, such as text or
            rows of pins, may show more. In a single picture a grating of bars along the rows is detected as a light.
        min_cycles: min. cycles of the light in its box, 2 or above; with fewer, edges and blinds resemble lights.
        max_sources: max. lights per frame, the strongest; 1 or above.
        frame: index of the only frame that is searched; its neighbours are compared with it. None: all are searched.

    Returns:
        The lights of all frames; within a frame the most probable first. Of two frames or more, the phase of a light
        moves with the clock, that of a texture stays: what stands still is no light, unless frequency times
        ``camera.frame_time`` is whole within its error.
    """
    pictures = as_grey_frames(frames, "frames", camera.scan_axis)
    found = _core.detect_sources(pictures, camera._handle, false_alarms, min_cycles, max_sources, frame)
    return [source_of(values, pictures.shape[1:], camera.scan_axis) for values in found]


def source_of(values: tuple[Any, ...], shape: tuple[int, ...], scan_axis: str) -> LightSource:
    """Convert the core's values; ``shape``: rows and columns of the picture in time order."""
    frame, box, *measured, reflection_of, by_phase, merged, joined, flags = values
    x, y, width, height = stored_box(box, shape, scan_axis)
    if reflection_of is not None:
        reason = "frequency and phase" if by_phase else "frequency"
    else:
        reason = "waveform" if joined else "overlap" if merged else ""
    return LightSource(*(frame, x, y, width, height, *measured, reflection_of, reason, merged, Flag(flags)))
