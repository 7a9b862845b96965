"""Receivers with state: frames in, payloads out."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s, as_frames, box_in_time_order, split_colours, stored_box
from ocisac_fast.core.checks import Finite, InnerShare, Positive, checked, checked_class, count, shown
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.regions import Region
from ocisac_fast.core.results import Result
from ocisac_fast.exposure.choice import BestExposure
from ocisac_fast.packets.transmission import PacketFormat, Payload, Stretch


@dataclass(frozen=True, slots=True, repr=False)
class ReceivedFrame(Result):
    """Result of a frame. If no chips were detected, ``bits`` is empty and the numbers are NaN.

    Attributes:
        frame: its number.
        outcome: "received"; otherwise the reason: "no_signal": no light with chips was detected; "not_finite": pixels
            that are not finite; "repeated": not after the last frame, ignored; "other_shape": shape differs from the
            last frame, ignored; "unsearched": the clock is lost and searches of the preceding frames failed; since
            searches are slow, up to seven frames in a row are skipped.
        missing: number of frames missing since the last one.
        colour: index of the colour used.
        bits: "0" and "1" in time order, 1 = bright; chips cut by the frame's edges are excluded, and
            those beyond chips in doubt where a frame fits no model.
        phase: row at which the first of them begins, half an exposure after the light's edge.
        rows_per_chip: length of a chip in rows.
        rows_per_chip_std: its standard error.
        chip_rate: 1 / (rows_per_chip * row_time), Hz.
        exposure: s, the camera's if given, else estimated.
        exposure_std: its standard error; 0 for the camera's.
        snr: (half the swing)^2 over the variance of a row about the model, a plain ratio; at most 1e12.
        error_rate: expected error rate of ``bits``, from their log-likelihood ratios.
        llr: (bits,) ln P(bright)/P(dark), nats.
        stretch: result of the packet's decoding; None if nothing was received.
        flags: :class:`ocisac_fast.Flag`.
        streams: of :class:`Receiver` alone: results of the other streams that the colours of the lamp send.
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
    llr: Float64s
    stretch: Stretch | None
    flags: Flag
    streams: tuple[ReceivedFrame, ...] = ()

    @property
    def payload(self) -> Payload | None:
        """The payload completed by this frame, or None."""
        return None if self.stretch is None else self.stretch.payload


@checked_class
class Receiver:
    """Receive packets of :func:`ocisac_fast.transmit` from one light in frames in time order.

    In each frame the columns are combined, and the chips' clock, the exposure and the levels are estimated (from the
    clock of earlier frames, else from a preamble, else from the rate alone). The chips are then detected and their
    bytes added to the packet. Frames may be missing, repeated or damaged; memory is bounded.

    Args:
        camera: row time; exposure if known, else it is estimated; frame time, which joins frames: without it only
            frames that show a block's header are used.
        chip_rate: Hz, accurate to 2 %. None: estimated blind, which needs an exposure below a chip. Chips that all come
            in pairs or more, as of a rate twice too high, are flagged (MODEL_MISFIT) from 13 runs of them on, in one
            frame or several.
        format: of the sender's packets; None: the defaults of :class:`ocisac_fast.packets.PacketFormat`.
        colour: index of the colour to use. None: the one with the strongest light, and from the fourth frame on the sum
            of all that shows it best. Where the colours send different chips, each stream is received as a light of its
            own (``ReceivedFrame.streams``; further sources of :class:`MultiReceiver`).
        search_passes: max. number of passes over a frame's rows in a search for its chips, which bounds the time;
            infinity: no bound. A preamble is found in about 50. None: 2000 for a known exposure, else 7000, below
            a second for 1080 rows.
    """

    __slots__ = ("_camera", "_colour", "_handle")

    def __init__(
        self,
        camera: Camera,
        *,
        chip_rate: float | None = None,
        format: PacketFormat | None = None,
        colour: int | None = None,
        search_passes: float | None = None,
    ) -> None:
        self._camera = camera
        self._colour = colour
        self._handle = _core.Receiver(
            **_data_options(camera, chip_rate, format, search_passes),
            **_gain_options(None),
            sense_frequency=None,
            data=True,
            whole_picture=True,
            regions=(),
            max_sources=1,
        )

    @checked
    def push(
        self,
        frame: npt.ArrayLike,
        *,
        number: int | None = None,
        time: float | None = None,
        exposure: float | None = None,
        gain: float | None = None,
    ) -> ReceivedFrame:
        """Process the next frame.

        Args:
            frame: (rows,), (rows, columns) or (rows, columns, colours), rows in time order; any strides, no copy for
                uint8, uint16, float32 and float64.
            number: of the frame, counting missing ones; ascending. None: one after the last; frames that are missing
                all the same are found by their clock, and one that is given twice is left out.
            time: s, time stamp of the frame's first row from any origin, ascending; for all frames or none. It joins
                frames instead of their numbers and needs no frame time of the camera. With one, stamps may be rounded,
                as to milliseconds: the chips show after some frames whether the frame time counts them better.
            exposure: s, of this frame, where it is another than the camera's; it is checked by the rows.
            gain: factor of the pixel values, above 0, where automatic gain changes it from frame to frame.
        """
        colours = frame_colours(frame, self._camera, self._colour)
        lights = self._handle.push(colours, number, time, exposure, gain)
        lights.sort(key=lambda light: light["source"])
        first, *others = (_received_frame(light["received"], self._camera, self._colour) for light in lights)
        return replace(first, streams=tuple(others)) if others else first


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True)
class GainOptions:
    """Measurement of the gain of each light's tone by :class:`MultiReceiver`.

    Args:
        frequency: Hz of the tone, above 0. None: estimated at the detection of a light.
        waveform: ``"tone"``, or ``"square"`` with the harmonics below half the row rate.
        duty: bright share of the square wave, inside (0, 1).
        background: light of other sources, DN above dark.
    """

    frequency: Positive | None = None
    waveform: Literal["tone", "square"] = "tone"
    duty: InnerShare = 0.5
    background: Finite = 0.0


@dataclass(frozen=True, slots=True, repr=False)
class LightGain(Result):
    """The gain of a light's tone in a frame from its pooled columns, as in :func:`ocisac_fast.tone_gain`.

    Attributes:
        frequency: Hz, given or estimated at the detection of the light; NaN without a tone.
        frequency_std: its standard error; NaN for a given frequency.
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


@dataclass(frozen=True, slots=True, repr=False)
class SourceFrame(Result):
    """One light in a frame.

    Attributes:
        frame: number of the frame.
        source: number of the light, from 0 in the order of detection; never reused.
        region: of reception, pixels as stored.
        searched: True if lights were searched in this frame.
        received: its data, ``phase`` is a row of the picture; None without ``data``, except for ignored frames.
        gain: gain of its tone; None without ``gain``.
        suggestion: best exposure for the light (eq. 18); None while no frequency is known.
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
    """Receive several lights in one picture, each with its own packets and gain, as ``ocisac-rx`` does.

    The strongest light is received from the first frame on. Further lights side by side are separated by columns of
    different swing, lights above each other by rows without swing in between, if three frames in a row agree; lights
    that touch must be given as regions. The picture is searched again periodically, so lights may appear and disappear.
    A light's region follows it along the columns.

    Args:
        camera, chip_rate, format, colour, search_passes: as in :class:`Receiver`; equal for all lights.
        regions: boxes (x, y, width, height) of the lights, pixels as stored; empty: searched.
        max_sources: max. number of lights of the search.
        data: receive chips.
        gain: measure the gain of each light's tone with these options; None: no gain.
        sense_frequency: Hz of the moving scene, for the suggested exposure.
    """

    __slots__ = ("_camera", "_colour", "_handle", "_make", "_regions")

    def __init__(
        self,
        camera: Camera,
        *,
        chip_rate: float | None = None,
        format: PacketFormat | None = None,
        colour: int | None = None,
        search_passes: float | None = None,
        regions: Sequence[tuple[int, int, int, int]] = (),
        max_sources: int = 8,
        data: bool = True,
        gain: GainOptions | None = None,
        sense_frequency: float | None = None,
    ) -> None:
        self._camera = camera
        self._colour = colour
        self._regions = [_region(region) for region in regions]
        self._make = functools.partial(
            _core.Receiver,
            **_data_options(camera, chip_rate, format, search_passes),
            **_gain_options(gain),
            sense_frequency=sense_frequency,
            data=data,
            whole_picture=False,
            max_sources=count("max_sources", max_sources, 1),
        )
        self._handle = self._make(regions=self._regions)

    @checked
    def push(
        self,
        frame: npt.ArrayLike,
        *,
        number: int | None = None,
        time: float | None = None,
        exposure: float | None = None,
        gain: float | None = None,
    ) -> list[SourceFrame]:
        """Process the next frame; returns the result of each light, the strongest first; at least one result.

        Args:
            frame: (rows, columns) or (rows, columns, colours).
            number, time, exposure, gain: as in :meth:`Receiver.push`.

        Raises:
            ValueError: as :meth:`Receiver.push`; a region outside the first frame.
        """
        axis, colours = self._camera.scan_axis, frame_colours(frame, self._camera, self._colour)
        shape = colours[0].shape[1:]
        if self._regions and axis != "y":
            self._handle = self._make(regions=[_turned(region, shape, axis) for region in self._regions])
            self._regions = []
        lights = self._handle.push(colours, number, time, exposure, gain)
        return [self._source_frame(**light | {"region": stored_box(light["region"], shape, axis)}) for light in lights]

    def _source_frame(self, received: Any, gain: Any, suggestion: Any, **values: Any) -> SourceFrame:
        return SourceFrame(
            received=None if received is None else _received_frame(received, self._camera, self._colour),
            gain=None if gain is None else LightGain(*(*gain[:-1], Flag(gain[-1]))),
            suggestion=None if suggestion is None else BestExposure(*suggestion),
            **values,
        )


def _data_options(
    camera: Camera, chip_rate: float | None, format: PacketFormat | None, search_passes: float | None
) -> dict[str, Any]:
    return {
        "camera": camera._handle,
        "chip_rate": chip_rate,
        "search_passes": search_passes,
        **(format or PacketFormat())._for_core(),
    }


def _gain_options(gain: GainOptions | None) -> dict[str, Any]:
    return {"gain": gain is not None, **asdict(gain or GainOptions())}


def _turned(region: Region, shape: tuple[int, ...], scan_axis: str) -> Region:
    box = box_in_time_order(region, shape, scan_axis)
    if min(box) < 0:
        raise ValueError(f"regions: got {shown(region)}, allowed: boxes within the picture")
    return box


def _region(region: tuple[Any, ...]) -> Region:
    if min(region) < 0:
        raise ValueError(f"regions: got {shown(region)}, allowed: (x, y, width, height), whole numbers from 0")
    return Region(*map(int, region))


def frame_colours(frame: npt.ArrayLike, camera: Camera, colour: int | None) -> list[npt.NDArray[Any]]:
    """One frame in the form that the core reads: a view of each colour."""
    return split_colours(as_frames(frame, "frame", camera.scan_axis, single=True), colour)


def frame_values(values: dict[str, Any], colour_asked: int | None) -> dict[str, Any]:
    """The core's values of a frame as results have them; ``colour_asked``: the only one that it got."""
    stretch = None if values["stretch"] is None else Stretch._of(values["stretch"])
    colour = values["colour"] if colour_asked is None else colour_asked
    return values | {"stretch": stretch, "colour": colour, "flags": Flag(values["flags"])}


def _received_frame(values: dict[str, Any], camera: Camera, colour: int | None) -> ReceivedFrame:
    rate = 1.0 / (values["rows_per_chip"] * camera.row_period)
    return ReceivedFrame(chip_rate=rate, **frame_values(values, colour))
