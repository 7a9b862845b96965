"""Blind receiver of bits from frames, for exposures shorter than a chip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s, as_frames, split_colours
from ocisac_fast.core.checks import checked
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.results import Result


@dataclass(frozen=True, slots=True, repr=False)
class Received(Result):
    """Chips of one source in one frame.

    If nothing could be decoded, ``bits`` is empty, the numbers are NaN and ``flags`` give the reason.

    Attributes:
        frame: index of the frame.
        source: index of the source in the frame, the strongest first.
        colour: index of the colour used, or that shows the source best; 0 for grey frames.
        bits: "0" and "1" in time order, 1 = bright; chips cut by the frame's edges are excluded. Of a
            lamp whose sides and whose end are seen in the frame (it fades, has a round outline, or other lamps follow
            above or below), chips of its rows alone, less those where a round one is too narrow to tell;
            other dark rows at the ends may be those of an idle light.
        rows_per_chip: length of a chip in rows.
        rows_per_chip_std: its standard error.
        chip_rate: 1 / (rows_per_chip * row_time), Hz.
        chip_rate_std: its standard error.
        phase: row at which the first chip of ``bits`` begins, fractional: the middle of the ramp that the exposure
            makes of an edge, half an exposure after the light's edge. Chip k begins at ``phase + k * rows_per_chip``.
        snr: (half the swing)^2 over the variance of the chips about their levels, a plain ratio; at most 1e12.
        levels: (2, chips) light of a dark and of a bright chip at each chip, DN above dark; they follow the gradient.
        relative_levels: (chips,) light of each chip: -1 at the dark level, 1 at the bright one; 0 in rows in which no
            light is seen, whose bits are guesses: also of dark chips beyond the outermost bright ones of a lamp that
            ends within the frame, and between a lamp and a reflection of 2/3 of its light or less.
        weights: (columns,) share of each column in the signal, sum 1; 0 for columns that are not used.
        columns: indices of the columns with a weight above 0.
        flags: :class:`ocisac_fast.Flag`.
        colour_weights: (colours,) weights of the colours' light in the signal: one colour, the sum of those that agree,
            or the sum that follows one stream of a lamp and no other one.
    """

    frame: int
    source: int
    colour: int
    bits: str
    rows_per_chip: float
    rows_per_chip_std: float
    chip_rate: float
    chip_rate_std: float
    phase: float
    snr: float
    levels: Float64s
    relative_levels: Float64s
    weights: Float64s
    columns: npt.NDArray[np.intp]
    flags: Flag
    colour_weights: Float64s


@checked
def receive(
    frames: npt.ArrayLike,
    camera: Camera,
    *,
    chip_rate: float | None = None,
    colour: int | None = None,
) -> list[Received]:
    """Receive the raw bits of a light in every frame, blind: columns, colour, rate and phase are estimated.

    Columns are combined with the weights that maximise the signal-to-noise ratio, without saturated ones. The chip
    lattice is the one of minimum description length for the signal's edges. Each chip is compared with a threshold half
    way between the levels of its dark and bright neighbours. See docs/explanation/receiver.md.

    Args:
        frames: (rows,), (rows, columns) or (frames, rows, columns), or (frames, rows, columns, colours) for colour;
            rows in time order. Any strides, no copy for uint8, uint16, float32 and float64.
        camera: row time (if unknown, rates are per row) and where known the exposure, tone curve, dark and white level.
            A stated exposure longer than a chip is flagged (LONG_EXPOSURE). State it where it may be: through one
            above 1.2 chips the chips of a line code may look like other chips of a shorter exposure.
        chip_rate: Hz, above 0 and at most half the row rate; searched within 3 %; where every run is a multiple of n
            chips, the rate is an n-th of it, with fewer than 12 edges flagged (TOO_FEW_EDGES) and with fewer than 8 not
            tried. None: estimated, from 2 to 64 rows per chip and at least 4 chips per frame.
        colour: index of the colour to use. None: the one with the strongest light; where a single lamp sends streams of
            chips that differ from colour to colour, all of them, each a source.

    Returns:
        At least one :class:`Received` for each frame, in the order of the frames, the strongest source first. Several
        sources are separated if they are side by side or above each other; a single one by its
        colours, which are unmixed blindly (camera
        and lamp have other primaries). Further ones are returned only if their bits are certain or
        those of a lamp without data (PERIODIC).
    """
    rate = None if chip_rate is None else float(chip_rate)
    results = _core.receive(
        colours=split_colours(as_frames(frames, "frames", camera.scan_axis), colour),
        camera=camera._handle,
        chip_rate=rate,
    )
    return [_received(camera, 0 if colour is None else colour, **values) for values in results]


def _received(camera: Camera, first_colour: int, colour: int, dark: Float64s, bright: Float64s, **own: Any) -> Received:
    rate = 1 / (own["rows_per_chip"] * camera.row_period)
    return Received(
        colour=colour + first_colour,
        chip_rate=rate,
        chip_rate_std=rate * own["rows_per_chip_std"] / own["rows_per_chip"],
        levels=np.stack([dark, bright]),
        columns=np.flatnonzero(own["weights"]),
        **own | {"flags": Flag(own["flags"])},
    )
