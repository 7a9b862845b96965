"""Every modulated light in a picture: where it is, how fast it flickers, and whether it carries data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import as_grey_frames, stored_box
from ocisac_fast.core.checks import checked
from ocisac_fast.core.flags import Flag


@dataclass(frozen=True, slots=True)
class LightSource:
    """A modulated light in one frame.

    Attributes:
        frame: index of the frame.
        x, y: top left corner of its box, pixels as stored.
        width, height: of its box, pixels as stored: where the swing is above 15 % of its largest. Of a light in parts
            the box of all, and what follows of the strongest part.
        frequency: Hz, below half the row rate; that of the strongest tone for a light that carries data.
        frequency_std: its standard error, Hz.
        gain, gain_std: of the light in the box, as of :func:`tone_gain` with no background taken off.
        phase: of the fundamental at the end of row 0's exposure, rad, as of :func:`tone_gain`.
        mean: light in the box, DN above dark.
        snr: power of the periodic swing over that of what it does not explain, in the logarithm of the light: texture
            and other light count as noise; a plain ratio. Of data found by their waveform: of all common swing.
        amplitude: of the fundamental where it is brightest, DN; of data found by their waveform its root mean square.
        periodic: share of the swing common to all columns that is periodic; 0 for data found by their waveform.
        carries_data: that share is below 0.7, or no tone goes through all its parts: not a tone or a square wave.
        reflection_of: index in the list of the frame's lights of a stronger one that this one reflects; else None.
        reason: why it is taken for a reflection ("frequency and phase", or "frequency" where too many rows lie between
            the two to compare phases), or why findings were merged ("overlap"; "waveform": parts beside or above each
            other, and what lies between, swing alike); "" for a light found once.
        merged: number of findings of the same light that were merged into it.
        flags: :class:`ocisac_fast.Flag` of the gain.
    """

    frame: int
    x: int
    y: int
    width: int
    height: int
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


@checked
def detect_sources(
    frames: npt.ArrayLike,
    camera: Camera,
    *,
    false_alarms: float = 0.02,
    min_cycles: float = 3.0,
    max_sources: int = 64,
) -> list[LightSource]:
    """Find every modulated light in a picture, frame by frame.

    A light multiplies a picture: p(row, column) = light(row) picture(row, column), so that the logarithm of
    neighbouring columns swings together, each about its own mean. Tiles of 32 rows and three groups of columns at
    several scales are screened for a tone common to the groups; what passes gets its box by demodulation and its
    frequency by the largest energy of f, 2f and 3f in log light weighted by the local swing. What is no tone is a light
    that sends data where all its columns have one waveform, with more edges and a better clock than a picture has.

    Args:
        frames: (rows, columns) or (frames, rows, columns), rows in time order, DN; at least 32 rows, or nothing is
            found.
        camera: row time; exposure, tone curve, dark and white level where known.
        false_alarms: expected number of false lights in a picture that holds none, above 0 up to 1. At most so many,
            and at 0.1 and below about so many on the texture that passes for light most often (boxes one over
            another; 720 x 960 pixels); fewer on noise, clouds and text. A grating of bars is a light to one picture.
        min_cycles: fewest cycles of the light in its box, 2 or above; below 3, edges and blinds pass for lights.
        max_sources: lights a frame, the strongest; 1 or above.

    Returns:
        The lights of all frames, those of a frame the strongest first.

    Raises:
        ValueError: wrong shape or type, samples that are not finite, or an option out of range.
    """
    pictures = as_grey_frames(frames, "frames", camera.scan_axis)
    found = _core.detect_sources(pictures, camera._handle, false_alarms, min_cycles, max_sources)
    return [source_of(values, pictures.shape[1:], camera.scan_axis) for values in found]


def source_of(values: tuple[Any, ...], shape: tuple[int, ...], scan_axis: str) -> LightSource:
    """From the core's values; ``shape``: rows and columns of the picture in time order."""
    frame, column, row, columns, rows, *measured, reflection_of, by_phase, merged, joined, flags = values
    x, y, width, height = stored_box((column, row, columns, rows), shape, scan_axis)
    if reflection_of is not None:
        reason = "frequency and phase" if by_phase else "frequency"
    else:
        reason = "waveform" if joined else "overlap" if merged else ""
    return LightSource(*(frame, x, y, width, height, *measured, reflection_of, reason, merged, Flag(flags)))
