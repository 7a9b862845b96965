"""The receiver with a memory: frames in, payloads out."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import as_frames, box_in_time_order, split_colours, stored_box
from ocisac_fast.core.checks import checked, checked_class, count
from ocisac_fast.core.flags import Flag
from ocisac_fast.exposure.choice import BestExposure
from ocisac_fast.packets.transmission import Payload, Stretch, as_line_code

FloatArray = npt.NDArray[np.float64]
Region = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True)
class ReceivedFrame:
    """What a frame gave. Where no chips were detected, ``bits`` is empty and the numbers are NaN.

    Attributes:
        frame: its number.
        outcome: "received"; or why there is nothing: "no_signal": no light with chips was found; "not_finite": pixels
            that are no numbers; "repeated": not after the last frame, left out; "other_shape": not as the last frame,
            left out; "unsearched": the clock is lost and frames just before were searched in vain (searches take
            long), at most seven in a row are left out.
        missing: frames between the last one and this, by their numbers.
        colour: index of the colour that was read.
        bits: "0" and "1" in time order, 1 = bright; chips that the frame's edges cut are left out.
        phase: row at which the first of them begins, half an exposure after the light's own edge.
        rows_per_chip: length of a chip in rows.
        rows_per_chip_std: its standard error.
        chip_rate: 1 / (rows_per_chip * row_time), Hz.
        exposure: s, the camera's, or estimated where that is not given.
        exposure_std: its standard error; 0 where it is the camera's.
        snr: (half the swing)^2 over the variance of a row about the model, a plain ratio; at most 1e12.
        error_rate: of ``bits``, as their log-likelihood ratios let expect.
        llr: (bits,) ln P(bright)/P(dark), nats.
        stretch: what the packet took of the frame; None where nothing was received.
        flags: :class:`ocisac_fast.Flag`.
    """

    frame: int
    outcome: str
    missing: int
    colour: int
    bits: str
    phase: float
    rows_per_chip: float
    rows_per_chip_std: float
    chip_rate: float
    exposure: float
    exposure_std: float
    snr: float
    error_rate: float
    llr: FloatArray
    stretch: Stretch | None
    flags: Flag

    @property
    def payload(self) -> Payload | None:
        """The payload that this frame made whole."""
        return None if self.stretch is None else self.stretch.payload


@checked_class
class Receiver:
    """One light in frames that come in time order; its packets, as :func:`ocisac_fast.transmit` makes them.

    In each frame the columns are combined, the chips' clock, the exposure and the levels estimated (from the clock of
    the frames before, else from a preamble, else from the rate alone), the chips detected, and their bytes put into
    the packet. Frames may be missing, repeated or damaged; memory is bounded.

    Args:
        camera: row time; exposure where known, else it is estimated; frame time, by which frames are joined: without it
            only frames that show a block's header count.
        chip_rate: Hz, good to 2 %. None: found blind, which needs an exposure below a chip.
        line_code: as the sender's, like ``block_bytes`` and ``preamble``; see :func:`ocisac_fast.transmit`.
        block_bytes: coded bytes of a block.
        preamble: "standard" or "lengthened".
        colour: index of the colour to read. None: the one in which the light stands out most.
        search_passes: passes over a frame's rows after which the search for its chips ends, which bounds its time;
            infinity: no bound. A preamble is found in about 50. None: 2000 where the exposure is known, else 5000,
            about half a second for 1080 rows.

    Raises:
        ValueError: an argument outside its range; the message names it.
    """

    __slots__ = ("_camera", "_colour", "_handle")

    def __init__(
        self,
        camera: Camera,
        *,
        chip_rate: float | None = None,
        line_code: str | Sequence[str] = "manchester",
        block_bytes: int = 16,
        preamble: str = "standard",
        colour: int | None = None,
        search_passes: float | None = None,
    ) -> None:
        self._camera = camera
        self._colour = colour
        self._handle = _core.Receiver(
            **_data_options(camera, chip_rate, line_code, block_bytes, preamble, search_passes),
            **_gain_options(),
            data=True,
            whole_picture=True,
            regions=(),
            max_sources=1,
        )

    @checked
    def push(self, frame: npt.ArrayLike, number: int | None = None) -> ReceivedFrame:
        """The next frame.

        Args:
            frame: (rows,), (rows, columns) or (rows, columns, colours), rows in time order; any strides, no copy for
                uint8, uint16, float32 and float64.
            number: of the frame, counting those that are missing; ascending. None: one after the last.

        Raises:
            ValueError: a wrong shape or type; a number that is no whole one.
        """
        (light,) = self._handle.push(frame_colours(frame, self._camera, self._colour), frame_number(number))
        return _received_frame(light[4], self._camera.row_period, self._colour)


@dataclass(frozen=True, slots=True)
class LightGain:
    """The gain of a light's tone in a frame, its columns pooled, as of :func:`ocisac_fast.tone_gain`.

    Attributes:
        frequency: Hz, as given or as estimated when the light was found; NaN where no tone was found.
        frequency_std: its standard error; NaN where the frequency was given.
        gain: normalised gain.
        gain_std: its standard error.
        phase: rad.
        mean: DN above dark.
        snr: a plain ratio.
        flags: :class:`ocisac_fast.Flag`.
    """

    frequency: float
    frequency_std: float
    gain: float
    gain_std: float
    phase: float
    mean: float
    snr: float
    flags: Flag


@dataclass(frozen=True, slots=True)
class SourceFrame:
    """One light in a frame.

    Attributes:
        frame: number of the frame.
        source: number of the light, from 0 in the order in which they were found; never given again.
        region: (x, y, width, height) of the box in which it was received: pixels as stored.
        searched: lights were searched in this frame.
        received: its data, ``phase`` is a row of the picture; None where no data is wanted, but for frames left out.
        gain: gain of its tone; None where it is not wanted.
        suggestion: exposure that suits the light (eq. 18); None while no frequency is known.
    """

    frame: int
    source: int
    region: Region
    searched: bool
    received: ReceivedFrame | None
    gain: LightGain | None
    suggestion: BestExposure | None


@checked_class
class MultiReceiver:
    """The lights in one picture, each its own stream of packets and its own gain: what ``ocisac-rx`` runs.

    The strongest light is received from the first frame on. Further lights beside it are told apart by columns that
    swing differently, lights above each other by rows between them in which nothing swings, where three frames in a
    row agree; lights that touch must be given as regions. The picture is searched anew from time to time: lights may
    come and go. A light's region follows it along the columns.

    Args:
        camera, chip_rate, line_code, block_bytes, preamble, colour, search_passes: as of :class:`Receiver`; all lights
            use the same.
        regions: boxes (x, y, width, height) of the lights, pixels as stored; empty: searched.
        max_sources: lights that are searched.
        data: whether chips are received.
        gain: whether the gain of each light's tone is measured.
        frequency: Hz of the tone. None: estimated when a light is found.
        waveform, duty, background: as of :func:`ocisac_fast.tone_gain`.
        sense_frequency: Hz of the moving scene, for the suggested exposure.

    Raises:
        ValueError: an argument outside its range; the message names it.
    """

    __slots__ = ("_camera", "_colour", "_handle", "_make", "_regions")

    def __init__(
        self,
        camera: Camera,
        *,
        chip_rate: float | None = None,
        line_code: str | Sequence[str] = "manchester",
        block_bytes: int = 16,
        preamble: str = "standard",
        colour: int | None = None,
        search_passes: float | None = None,
        regions: Sequence[Region] = (),
        max_sources: int = 8,
        data: bool = True,
        gain: bool = False,
        frequency: float | None = None,
        waveform: Literal["tone", "square"] = "tone",
        duty: float = 0.5,
        background: float = 0.0,
        sense_frequency: float | None = None,
    ) -> None:
        self._camera = camera
        self._colour = colour
        self._regions = [_region(region) for region in regions]
        self._make = functools.partial(
            _core.Receiver,
            **_data_options(camera, chip_rate, line_code, block_bytes, preamble, search_passes),
            **_gain_options(gain, frequency, waveform, duty, background, sense_frequency),
            data=bool(data),
            whole_picture=False,
            max_sources=count("max_sources", max_sources, 1),
        )
        self._handle = self._make(regions=self._regions)
        self._handle = self._make(regions=self._regions)

    @checked
    def push(self, frame: npt.ArrayLike, number: int | None = None) -> list[SourceFrame]:
        """The next frame: what was received of each light, the strongest first; at least one result.

        Args:
            frame: (rows, columns) or (rows, columns, colours), as of :meth:`Receiver.push`.
            number: of the frame, counting those that are missing; ascending. None: one after the last.

        Raises:
            ValueError: a wrong shape or type; a number that is no whole one; a region outside the first frame.
        """
        axis, colours = self._camera.scan_axis, frame_colours(frame, self._camera, self._colour)
        shape = colours[0].shape[1:]
        if self._regions and axis != "y":
            self._handle = self._make(regions=[_turned(region, shape, axis) for region in self._regions])
            self._regions = []
        lights = self._handle.push(colours, frame_number(number))
        return [self._source_frame(stored_box(light[2], shape, axis), light) for light in lights]

    def _source_frame(self, region: Region, values: tuple[Any, ...]) -> SourceFrame:
        frame, source, _, searched, received, gain, suggestion = values
        row_time = self._camera.row_period
        return SourceFrame(
            frame=frame,
            source=source,
            region=region,
            searched=searched,
            received=None if received is None else _received_frame(received, row_time, self._colour),
            gain=None if gain is None else LightGain(*gain[:-1], flags=Flag(gain[-1])),
            suggestion=None if suggestion is None else BestExposure(*suggestion),
        )


def _data_options(
    camera: Camera,
    chip_rate: float | None,
    line_code: str | Sequence[str],
    block_bytes: int,
    preamble: str,
    search_passes: float | None,
) -> dict[str, Any]:
    return {
        "camera": camera._handle,
        "chip_rate": None if chip_rate is None else float(chip_rate),
        "line_code": as_line_code(line_code)[1],
        "block_bytes": count("block_bytes", block_bytes, 1),
        "preamble": preamble,
        "search_passes": None if search_passes is None else float(search_passes),
    }


def _gain_options(
    gain: bool = False,
    frequency: float | None = None,
    waveform: str = "tone",
    duty: float = 0.5,
    background: float = 0.0,
    sense_frequency: float | None = None,
) -> dict[str, Any]:
    return {
        "gain": bool(gain),
        "frequency": None if frequency is None else float(frequency),
        "waveform": waveform,
        "duty": float(duty),
        "background": float(background),
        "sense_frequency": None if sense_frequency is None else float(sense_frequency),
    }


def _turned(region: Region, shape: tuple[int, ...], scan_axis: str) -> Region:
    box = box_in_time_order(region, shape, scan_axis)
    if min(box) < 0:
        raise ValueError(f"regions: got {region}, allowed: boxes within the picture")
    return box


def _region(region: Region) -> Region:
    box = tuple(region)
    if len(box) != 4 or not all(isinstance(value, (int, np.integer)) and value >= 0 for value in box):
        raise ValueError(f"regions: got {region!r}, allowed: (x, y, width, height), whole numbers from 0")
    return int(box[0]), int(box[1]), int(box[2]), int(box[3])


def frame_number(number: int | None) -> int | None:
    if number is not None and (isinstance(number, bool) or not isinstance(number, (int, np.integer))):
        raise ValueError(f"number: got {number!r}, allowed: a whole number, or None")
    return None if number is None else int(number)


def frame_colours(frame: npt.ArrayLike, camera: Camera, colour: int | None) -> list[npt.NDArray[Any]]:
    """One frame as the core takes it: a view of each colour."""
    return split_colours(as_frames(frame, "frame", camera.scan_axis, single=True), colour)


def _received_frame(values: tuple[Any, ...], row_time: float, colour_asked: int | None) -> ReceivedFrame:
    index, outcome, missing, colour, bits, phase, rows, rows_std, exposure, exposure_std, *rest = values
    snr, error_rate, llr, stretch, flags = rest
    return ReceivedFrame(
        frame=index,
        outcome=outcome,
        missing=missing,
        colour=colour if colour_asked is None else colour_asked,
        bits=bits,
        phase=phase,
        rows_per_chip=rows,
        rows_per_chip_std=rows_std,
        chip_rate=1.0 / (rows * row_time),
        exposure=exposure,
        exposure_std=exposure_std,
        snr=snr,
        error_rate=error_rate,
        llr=llr,
        stretch=None if stretch is None else Stretch._of(stretch),
        flags=Flag(flags),
    )
