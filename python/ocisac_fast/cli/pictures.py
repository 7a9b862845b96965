"""Common options of the commands that read pictures, and the camera and frames that they define."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import os
import re
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

import click
import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cli.errors import error_text
from ocisac_fast.cli.output import emit_note, is_collected
from ocisac_fast.cli.units import RATE, ROW_TIME, TIME, Parsed, Quantity
from ocisac_fast.core.arrays import as_frames
from ocisac_fast.core.regions import Region
from ocisac_fast.files import FileError, Part, RecordingStream, open_recording
from ocisac_fast.files.recording import Frame, gathered
from ocisac_fast.lights import find_scan_axis

_RED_GREEN_BLUE = {"r": 0, "g": 1, "b": 2}
_LUMA_WEIGHTS = (0.299, 0.587, 0.114)  # ITU-R BT.601
_BATCH_BYTES = 64 << 20
_OF_FRAMES = ("columns: ", "frames: ", "light: ")  # begins an error of theirs
_SURE_LIGHT = 0.998  # probability of a light that contradicts a statement


def _region(text: str) -> Region:
    if not re.fullmatch(r"\s*\d{1,9}\s*(,\s*\d{1,9}\s*){3}", text):
        raise ValueError(text)
    return Region(*map(int, text.split(",")))


def _tone_curve(text: str) -> tuple[str, float]:
    curve, _, power = text.lower().partition(":")
    if curve not in ("linear", "srgb", "hlg", "pq", "gamma") or (power and curve != "gamma"):
        raise ValueError(text)
    return curve, float(power or 2.2)


def _channel(text: str) -> str | int:
    word = text.lower()
    if word in ("auto", "y", *_RED_GREEN_BLUE):
        return word
    if not re.fullmatch(r"\d{1,3}", word):
        raise ValueError(text)
    return int(word)


REGION = Parsed("x,y,w,h", _region, "four whole numbers x,y,w,h in pixels, such as 0,0,640,480")


@dataclasses.dataclass(frozen=True, kw_only=True)
class PictureOptions:
    """Options for reading a recording."""

    row_time: Annotated[Quantity | None, ROW_TIME, "Time from one row to the next; without it, rates are per row."] = (
        None
    )
    exposure: Annotated[Quantity | None, TIME, "Exposure time of a row."] = None
    scan_axis: Annotated[
        str,
        click.Choice(["auto", "y", "x", "-y", "-x"]),
        "Direction in which rows are read out: y: down, x: right; auto: y or x, whichever shows lights.",
    ] = "auto"
    region: Annotated[Region | None, REGION, "Part of the picture, from its top left corner."] = None
    channel: Annotated[str | int, Parsed("auto|r|g|b|y|INDEX", _channel, "auto, r, g, b, y or an index from 0")] = (
        "auto"
    )
    waveform: Annotated[Literal["tone", "square"], "Waveform of the light."] = "tone"
    duty: Annotated[float, "Bright share of a square wave."] = 0.5
    tone_curve: Annotated[
        tuple[str, float] | None,
        Parsed("linear|gamma[:2.2]|srgb|hlg|pq", _tone_curve, "linear, srgb, hlg, pq, gamma or gamma:POWER"),
        "Tone curve; default: from the file, else as usual for its kind.",
    ] = None
    dark_level: Annotated[float | None, "Stored value of no light; default: from the file, else 0."] = None
    raw: Annotated[
        str | None,
        {"metavar": "WIDTHxHEIGHT[:gray8|gray16le]"},
        "Frames without headers, for example from a pipe.",
    ] = None
    white_level: Annotated[float | None, "Stored value of full light; default: from file or type."] = None
    frame_rate: Annotated[Quantity | None, RATE, "Frame rate; default: from the file."] = None

    def camera(self, stream: RecordingStream, usual: Mapping[str, str] | None = None) -> Camera:
        """The camera from the options, else from the file; without a row time if none is given.

        ``usual``: tone curves of kinds of files that state none, where they differ from the reader's.
        """
        if self.row_time is None and self.exposure is not None:
            raise click.UsageError("--exposure: needs --row-time")
        if self.row_time is None and self.frame_rate is not None:
            raise click.UsageError("--frame-rate: needs --row-time")
        row_time, exposure = (None if one is None else float(one) for one in (self.row_time, self.exposure))
        camera = stream.camera(row_time=row_time, exposure=exposure)
        curve, gamma = self.tone_curve or (
            (usual or {}).get(stream.response.assumed_for, camera.tone_curve),
            camera.gamma,
        )
        stated = {"dark_level": self.dark_level, "white_level": self.white_level, "scan_axis": self.scan_axis}
        changes: dict[str, Any] = {name: value for name, value in stated.items() if value not in (None, "auto")}
        if self.frame_rate is not None:
            changes["frame_time"] = 1.0 / float(self.frame_rate)
        return dataclasses.replace(camera, tone_curve=curve, gamma=gamma, **changes)

    def camera_for(
        self,
        stream: RecordingStream,
        first: Frame,
        *,
        axis_of_light: bool = True,
        usual: Mapping[str, str] | None = None,
    ) -> Camera:
        """`camera` for frames like ``first``, whose lights tell the read-out axis, or confirm a stated one."""
        camera, kind = self.camera(stream, usual), stream.response.assumed_for
        if kind and self.tone_curve is None and camera.tone_curve != "linear":
            power = f":{camera.gamma:g}" if camera.tone_curve == "gamma" else ""
            emit_note(
                f"no tone curve is stated: {camera.tone_curve}{power} is taken, as usual for {kind} (--tone-curve)"
            )
        if self.channel == "y" and camera.white_level is None and first.dtype.kind == "u":
            largest = float(np.iinfo(first.dtype).max)  # the weighted sum is of floats, whose full scale is 1
            camera = dataclasses.replace(camera, white_level=largest)
        return self._with_axis_of(first, camera) if axis_of_light else camera

    def _with_axis_of(self, frame: Frame, camera: Camera) -> Camera:
        """The camera with the axis that a first frame shows; a warning where both axes show lights.

        A stated axis is kept, with a warning where the frame clearly shows the other one.
        """
        stated = self.scan_axis != "auto"
        if stated and is_collected():
            return camera
        found = find_scan_axis(grey_of(select(frame, self)), Camera(row_time=1.0, dark_level=camera.dark_level))
        other = "xy"[found.axis == "x"]
        if stated:
            probability = found.probability["yx".index(found.axis)]
            if found.clear and probability > _SURE_LIGHT and self.scan_axis.endswith(other):
                warnings.warn(
                    f"--scan-axis: got {self.scan_axis}, but the picture shows lights along {found.axis} rather than "
                    f"along {other}: probably --scan-axis {found.axis}",
                    stacklevel=2,
                )
            return camera
        if not found.clear and max(found.energy) > 0.0:  # else there is nothing to read along either
            warnings.warn(
                f"--scan-axis: not clear from the picture, {found.axis} is used (the other one: --scan-axis {other})",
                stacklevel=2,
            )
        return dataclasses.replace(camera, scan_axis=found.axis)

    @property
    def gain_name(self) -> str:
        """Heading of gains: that of the fundamental of the waveform, which is a tone where none is given."""
        return "gain (tone)" if self.waveform == "tone" else "gain"

    def headings(self, names: Sequence[str]) -> tuple[str, ...]:
        """Headings of a table with gains."""
        return tuple(self.gain_name if name == "gain" else name for name in names)

    def names(self, axis: str) -> bool:
        """True if tables are to name ``axis``: it was found, and rows do not run down as mostly."""
        return self.scan_axis == "auto" and axis != "y"

    @property
    def in_hertz(self) -> bool:
        """True where rates are per second, False where they are per row for want of a row time."""
        return self.row_time is not None

    def in_units(self, facts: dict[str, Any]) -> dict[str, Any]:
        """The JSON object with keys that name the units of `camera`: without a row time, rows instead of seconds.

        ``chip_rate_hz`` is left out then, since ``rows_per_chip`` has the same content.
        """
        if self.in_hertz:
            return facts
        return {
            re.sub("_hz$", "_cycles_per_row", re.sub("exposure_s$", "exposure_rows", key)): value
            for key, value in facts.items()
            if key != "chip_rate_hz"
        }

    def in_picture(self, box: Region) -> Region:
        """Convert a box in the region to pixels of the stored picture."""
        left, top = (0, 0) if self.region is None else self.region[:2]
        return box._replace(x=box.x + left, y=box.y + top)

    def in_region(self, box: Region) -> Region:
        """The inverse of `in_picture`."""
        left, top = (0, 0) if self.region is None else self.region[:2]
        return box._replace(x=box.x - left, y=box.y - top)

    def check_frequency(self, name: str, value: Any) -> float | None:
        """A frequency in the units of `camera`: Hz, or cycles per row without a row time; None for auto."""
        if value is None or value == "auto":
            return None
        if self.row_time is None and value.has_unit:
            raise click.UsageError(f"{name}: Hz needs --row-time; without it give cycles per row")
        return float(value)


@dataclasses.dataclass(frozen=True)
class OpenPictures:
    """A recording opened with the options."""

    camera: Camera
    frames: Iterator[Frame]  # (height, width) or (height, width, colours) as stored, views where possible
    frame_count: int | None  # as announced

    def batches(self, later_bytes: int = _BATCH_BYTES) -> Iterator[Frame]:
        """The frames in arrays (frames, height, width, colours) of a bounded size, after the first of another.

        Several frames are copied as they are decoded, so that the decoder's memory is used again; one is not copied.
        """
        most = _BATCH_BYTES
        for frame in self.frames:
            room = max(most // frame.nbytes, 1)
            batch = itertools.chain([frame], itertools.islice(self.frames, room - 1))
            yield with_colours(gathered(batch, min(room, self.frame_count or room)))
            most = later_bytes

    def row_batches(self, later_bytes: int = _BATCH_BYTES) -> Iterator[Frame]:
        """`batches` as (frames, rows, columns, colours) with rows in time order, for ``camera.in_time_order``."""
        for batch in self.batches(later_bytes):
            yield as_frames(batch, scan_axis=self.camera.scan_axis)


def rows_and_columns(shape: tuple[int, ...], camera: Camera) -> tuple[int, int]:
    """Rows and columns of the camera in pictures of ``shape``, (height, width) first."""
    return (shape[1], shape[0]) if camera.scan_axis.endswith("x") else (shape[0], shape[1])


def stack(frames: list[Frame]) -> Frame:
    """(frames, height, width, colours) of pictures with or without colours; a view of a single one."""
    return with_colours(frames[0][np.newaxis] if len(frames) == 1 else np.stack(frames))


def with_colours(frames: Frame) -> Frame:
    """(frames, height, width, colours) of (frames, height, width) or the same."""
    return frames[..., np.newaxis] if frames.ndim == 3 else frames


@contextlib.contextmanager
def _silent_libraries() -> Iterator[None]:
    """Discard standard error: libtiff prints messages about damaged pictures in addition to our error."""
    if sys.stderr is None:  # closed: its number may be another file's
        yield
        return
    sys.stderr.flush()
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


@contextlib.contextmanager
def frames_of(path: str) -> Iterator[None]:
    """Within this, errors of frames name their file, as those of files do, and a lack of memory for them."""
    try:
        yield
    except MemoryError as error:
        raise FileError(f"{path}: {error_text(error)}") from error
    except ValueError as error:
        if not str(error).startswith(_OF_FRAMES):
            raise
        raise FileError(f"{path}: {error}") from error


@contextlib.contextmanager
def open_pictures(
    path: str, options: PictureOptions, part: Part | None = None, *, axis_of_light: bool = True
) -> Iterator[OpenPictures]:
    """Open a recording, or a part of its frames, arranged by the options.

    ``axis_of_light``: the first frame's lights tell the read-out axis, or confirm a stated one.
    """
    with frames_of(path), contextlib.ExitStack() as opened:
        with _silent_libraries():
            colour = options.channel in _RED_GREEN_BLUE
            stream = opened.enter_context(open_recording(path, colour=colour, raw=options.raw, part=part))
        frames = iter(stream)
        with _silent_libraries():
            first = next(frames)
        camera = options.camera_for(stream, first, axis_of_light=axis_of_light)
        arranged = (select(frame, options) for frame in itertools.chain([first], frames))
        yield OpenPictures(camera, arranged, stream.frame_count)


def select(frame: Frame, options: PictureOptions) -> Frame:
    """Region and channel as (height, width[, colours]), as stored: a view except for channel y."""
    return _of_channel(cropped(frame, options.region), options.channel)


def cropped(frame: Frame, region: Region | None) -> Frame:
    """The region of a frame as stored, a view."""
    if region is None:
        return frame
    rows, columns = frame.shape[:2]
    if not region.is_inside(columns, rows):
        got = ",".join(map(str, region))
        raise ValueError(f"--region: got {got}, allowed: x,y,w,h inside the picture of {columns} x {rows} pixels")
    return frame[region.y : region.bottom, region.x : region.right]


def _of_channel(frame: Frame, channel: str | int) -> Frame:
    """Select a channel; a grey picture has only y, 0 and auto."""
    colours = frame.shape[2] if frame.ndim == 3 else 1
    index = _RED_GREEN_BLUE.get(channel, 0) if isinstance(channel, str) else channel
    if channel in ("r", "g", "b") and colours < 3:
        raise ValueError(f"--channel: got {channel}, the picture is grey")
    if index >= colours:
        raise ValueError(f"--channel: got {index}, the picture has {colours}")
    if frame.ndim == 2:
        return frame
    if colours == 1:
        return frame[..., 0]
    if channel == "y":
        return np.asarray(frame[..., :3] @ np.array(_LUMA_WEIGHTS))
    return frame if channel == "auto" else frame[..., index]


def grey_of(frame: Frame) -> Frame:
    """Mean of the colours as whole stored values; for red, green and blue, green has twice the weight."""
    if frame.ndim == 2:
        return frame
    wide = np.uint32 if frame.dtype.kind == "u" else np.float64
    weights = (1, 2, 1) if frame.shape[2] == 3 else (1,) * frame.shape[2]
    total = np.zeros(frame.shape[:2], wide)
    for colour, weight in enumerate(weights):
        total += frame[..., colour] * wide(weight)
    return np.asarray(total // sum(weights) if frame.dtype.kind == "u" else total / sum(weights)).astype(frame.dtype)
