"""Contents of a recording: frames and the camera response that the file states."""

from __future__ import annotations

import contextlib
import errno
import math
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.checks import checked
from ocisac_fast.core.results import Result

Frame = npt.NDArray[Any]
KEPT_FRAMES = 4  # of a video, as they were decoded


class FileError(ValueError):
    """A file that cannot be read as a recording, or values that a file type cannot hold; the message names both."""


@contextlib.contextmanager
def naming(path: str | os.PathLike[str], *found: str | None) -> Iterator[None]:
    """Errors name the file; those of the system that name one of ``found``: others are of what is read meanwhile."""
    try:
        yield
    except FileError as error:
        message, name = str(error), os.fspath(path)
        raise FileError(message if message.startswith(f"{name}: ") else f"{name}: {message}") from error.__cause__
    except OSError as error:
        if error.filename not in found:
            raise
        raise OSError(error.errno or errno.EIO, error.strerror or str(error), os.fspath(path)) from error


class FileWarning(UserWarning):
    """A recording that was read incompletely."""


@dataclass(frozen=True, slots=True, repr=False)
class LightResponse(Result):
    """Relation of stored values to light; fields as in ``Camera``.

    Attributes:
        tone_curve: name of the curve.
        gamma: exponent from stored value to light, for ``"gamma"``.
        dark_level: stored value of no light (DN).
        white_level: stored value of full light (DN); None: the largest value of the array's type.
        stated_by: source of the statement (``"PNG sRGB chunk"``); empty where all is assumed.
        assumed_for: kind of file for which the curve is assumed (``"JPEG"``); empty where the file states it.
    """

    tone_curve: str = "linear"
    gamma: float = 2.2
    dark_level: float = 0.0
    white_level: float | None = None
    stated_by: str = ""
    assumed_for: str = ""


_LINEAR_PNG = b"\0\0\0\4gAMA\0\1\x86\xa0" + b"1\xe8\x96_"  # the chunk of a power of 1, with its check sum


class _Recorded:
    """Statements of a recording about its camera."""

    __slots__ = ()
    response: LightResponse
    frame_rate: float | None

    @checked
    def camera(
        self, *, row_time: float | None = None, exposure: float | None = None, dark_level: float | None = None
    ) -> Camera:
        """The camera: range, tone curve, levels and frame rate of the file, with what no file states.

        ``dataclasses.replace(camera, tone_curve="srgb")`` changes a value. Where the file states no tone curve
        (``response.assumed_for``), it is sRGB for JPEG and WebP, that of BT.709 for lossy videos (H.264, HEVC), else
        linear.

        Args:
            row_time: time from one row to the next, s, above 0; None: unknown, rates are per row.
            exposure: exposure time of a row, s, 0 or above; None: unknown.
            dark_level: stored value of no light; None: that of the file.
        """
        response = self.response
        return Camera(
            row_time,
            exposure,
            frame_time=1.0 / self.frame_rate if self.frame_rate and row_time is not None else None,
            tone_curve=response.tone_curve,
            gamma=response.gamma,
            dark_level=response.dark_level if dark_level is None else dark_level,
            white_level=response.white_level,
        )


@dataclass(frozen=True, slots=True, repr=False)
class Recording(_Recorded, Result):
    """All frames of a file.

    Attributes:
        frames: (frames, rows, columns) or (frames, rows, columns, colours), as stored: EXIF orientation is ignored,
            alpha dropped, colours in the order red, green, blue.
        kind: ``"picture"``, ``"video"`` or ``"array"``.
        response: range and tone curve that the file states.
        frame_rate: frames per second where the file states it, else None.
    """

    frames: Frame
    kind: str
    response: LightResponse
    frame_rate: float | None = None


@dataclass(frozen=True, slots=True, repr=False)
class Part(Result):
    """A stretch of a recording.

    Attributes:
        first, stop: frames ``first`` to ``stop - 1``, counted from 0.
        begin, end: time stamps of frames ``first`` and ``stop`` in a video; end None: the last stretch.
    """

    first: int
    stop: int
    begin: int | None = None
    end: int | None = None


@dataclass(frozen=True, slots=True)
class KeyFrames:
    """Frames at which reading can begin: their indices, and in a video their time stamps."""

    indices: list[int]
    stamps: list[int] | None
    frame_count: int


@dataclass(slots=True)
class VideoFormat:
    """Properties of a video that a processed copy keeps; numbers are those of ITU-T H.273."""

    path: Any  # place of the file, from which its sound is read; None: a pipe
    status: os.stat_result | None  # of the file that was opened there; None: a remote one
    has_sound: bool
    codec: str  # as FFmpeg names it, and the pixel format
    pixel_format: str
    limited: bool  # luma has black at 16 (of 8 bits)
    primaries: int  # of the colours, as transfer and matrix
    transfer: int
    matrix: int
    time_base: Fraction  # unit of the time stamps, s
    pixel_aspect: Fraction | None  # width of a pixel over its height; None: not stated
    display_matrix: tuple[int, ...] | None = None  # turn for display, 9 numbers, once a frame was read
    decoded: deque[tuple[Frame, Any]] = field(default_factory=lambda: deque(maxlen=KEPT_FRAMES))  # those read last


@dataclass(frozen=True, slots=True)
class PictureFormat:
    """Properties of a picture that a processed copy keeps."""

    orientation: int | None  # EXIF's, 1 to 8; None: not stated
    options: dict[str, bytes]  # EXIF data and ICC profile, as Pillow's save takes them
    chunks: bytes  # of a PNG file: colours, resolution, EXIF data
    alphas: list[Frame | None]  # opacity of the pages read so far, (rows, columns); None for a page without


class RecordingStream(_Recorded):
    """A file opened for reading one frame at a time; a context manager and an iterable of frames.

    Attributes:
        kind, response, frame_rate: as in ``Recording``.
        frame_count: number of frames that the file announces, or None; a damaged file may hold fewer.
        key_frames: function of a number of frames: where a longer recording can be cut, else None; reads the stream.
        video: format of a video's stream, else None.
        picture: format of a picture, else None.
        stamps: time stamps of the video's frames read so far, in its time base; None for a frame without one.
    """

    def __init__(
        self,
        frames: Iterator[Frame],
        kind: str,
        response: LightResponse,
        frame_rate: float | None = None,
        frame_count: int | None = None,
        close: Callable[[], object] | None = None,
        key_frames: Callable[[int], KeyFrames | None] = lambda _: None,
        video: VideoFormat | None = None,
        stamps: list[int | None] | None = None,
        picture: PictureFormat | None = None,
    ) -> None:
        self._frames, self.kind, self.response = frames, kind, response
        self.frame_rate, self.frame_count, self.key_frames = frame_rate, frame_count, key_frames
        self.video, self.picture, self.stamps = video, picture, [] if stamps is None else stamps
        self._cleanup = contextlib.ExitStack()
        if close is not None:
            self._cleanup.callback(close)

    @classmethod
    @checked
    def of_array(cls, frames: Frame, kind: str, response: LightResponse) -> RecordingStream:
        """Stream frames (frames, rows, columns[, colours]) from memory."""
        frames = np.asarray(frames)
        if frames.ndim < 3:
            raise ValueError(f"frames: got {frames.ndim} dimensions, allowed: (frames, rows, columns[, colours])")
        return cls(iter(frames), kind, response, frame_count=len(frames))

    @classmethod
    def linear(cls) -> RecordingStream:
        """An empty recording that states linear values, for ``write_frames(like=)``."""
        return cls(iter(()), "array", LightResponse(), picture=PictureFormat(None, {}, _LINEAR_PNG, []))

    @checked
    def time_of(self, frame: int) -> Fraction | None:
        """Time of one of the frames read so far, s; None where the video states none.

        Raises:
            ValueError: ``frame`` below 0.
        """
        if frame < 0:
            raise ValueError(f"frame: got {frame}, allowed: 0 or above")
        stamp = self.stamps[frame] if frame < len(self.stamps) else None
        return None if stamp is None or self.video is None else stamp * self.video.time_base

    @checked
    def map_frames(self, function: Callable[[Iterator[Frame]], Iterator[Frame]]) -> RecordingStream:
        """Pass this stream's frames through a function of their iterator."""
        self._frames = function(self._frames)
        return self

    def __iter__(self) -> Iterator[Frame]:
        return self._frames

    def __enter__(self) -> RecordingStream:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Release the file; frames already read stay valid."""
        self._cleanup.close()

    @checked
    def read(self, max_bytes: int) -> Recording:
        """Read all remaining frames; one further frame at a time is in memory.

        Raises:
            FileError: no frame, frames of different shapes or types, more than ``max_bytes`` of them, or more than
                memory holds.
        """
        try:
            return Recording(gathered(self, self.frame_count, max_bytes), self.kind, self.response, self.frame_rate)
        except MemoryError as error:
            size = str(error) or "out of memory"
            raise FileError(f"{size}, read it frame by frame (open_recording)") from error


def gathered(frames: Iterable[Frame], announced: int | None, max_bytes: float = math.inf) -> Frame:
    """(frames, ...) in one array, made for the ``announced`` number of frames: each is copied before the next is read.

    Raises:
        FileError: no frame, or more than ``max_bytes`` of them.
    """
    whole: Frame = np.empty(0)
    count = 0
    for frame in frames:
        if (count + 1) * frame.nbytes > max_bytes:
            raise FileError(f"more than {int(max_bytes) >> 20} MiB of frames (max_bytes), read it frame by frame")
        if count == 0:
            whole = frame[np.newaxis]
        elif count == 1:  # memory pages are committed when written: fewer frames may arrive
            room = int(min(announced or 2, max_bytes // frame.nbytes))
            first, whole = whole, np.empty((max(room, 2), *frame.shape), frame.dtype)
            whole[0], whole[1] = first[0], frame
            del first
        else:
            if count == len(whole):
                whole.resize((count + 1, *frame.shape), refcheck=False)  # moves no data where it is large
            whole[count] = frame
        count += 1
        del frame  # before the next one is made
    if count == 0:
        raise FileError("no frame in it")
    if count < len(whole):
        whole.resize((count, *whole.shape[1:]), refcheck=False)
    return whole
