"""Videos through FFmpeg (PyAV), one frame at a time: the coded luma plane, without a colour conversion."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import re
import struct
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ocisac_fast.files.colours import Conversion, downward, rgb_format, rgb_white
from ocisac_fast.files.extras import ffmpeg, opened_video, pyav
from ocisac_fast.files.films import FirstFilm
from ocisac_fast.files.parts import HEAD_BYTES, JPEGS, Ending, decoded_part, video_key_frames
from ocisac_fast.files.profiles import response_of_video, transfer_of
from ocisac_fast.files.raw import MOST_BYTES, read_bytes, require_at_most
from ocisac_fast.files.recording import (
    FileError,
    FileWarning,
    Frame,
    LightResponse,
    Part,
    RecordingStream,
    VideoFormat,
)
from ocisac_fast.files.remote import RemotePath

_REFUSED_CONTAINERS = {"tty", "hls", "dash", "concat", "srt", "webvtt", "ass", "ansi", "bin", "xbin", "adf", "idf"}
_LUMA_PLANE = re.compile(r"yuv[aj]?4\d\dp(?!.*msb)|gray|yaf|nv\d\d|[py][024]1[026](le|be)$")
_PACKED_LUMA = {"yuyv422": 0, "yvyu422": 0, "uyvy422": 1}  # first of every second byte
_UPPER_BITS = re.compile(r"[py][024]1[026](le|be)$")  # P010 and similar formats store their bits at the top of a word
FLOAT_GREY = ("grayf", "yaf")  # the scaler takes these for limited range, and cuts them at 1
_USUALLY_FULL = ("yuvj", "gray", "ya", "mono", "rgb", "bgr", "gbr", "argb", "abgr", "0rgb", "0bgr", "x2")
_LIMITED_RANGE, _FULL_RANGE = 1, 2
_ATTACHED_PICTURE = 1 << 10  # FFmpeg's AV_DISPOSITION_ATTACHED_PIC
_INTERLACED = (
    "interlaced: the rows of a frame are of two times, allowed: progressive frames (ffmpeg -vf separatefields: each "
    "field a frame of twice the row time; -vf setfield=prog: where the mark is wrong)"
)
_UNKNOWN = "not a picture, a video or a .npy array, or damaged beyond reading"
_MAX_PIXELS = 1 << 28
_PIECE, _MOST_SPOOLED = 1 << 20, 4 << 30  # bytes of a pipe, which may have no end
_MOST_BOXES = 10_000  # of an MP4 by a pipe before its index, each of which may be empty
_decoder_threads: ContextVar[int] = ContextVar("decoder_threads", default=0)  # 0: one for each processor


@contextlib.contextmanager
def decoder_threads(count: int) -> Iterator[None]:
    """Open videos with this number of threads for decoding; frames are the same with any."""
    token = _decoder_threads.set(count)
    try:
        yield
    finally:
        _decoder_threads.reset(token)


def open_video(
    source: Path | RemotePath | BinaryIO,
    name: str,
    colour: bool = False,
    part: Part | None = None,
    container: str | None = None,
) -> RecordingStream:
    """Open a video; frames are decoded on demand.

    Args:
        source: path, or a binary stream (spooled to a temporary file where its kind needs seeking).
        name: the file's name in warnings.
        colour: red, green and blue by a colour conversion instead of luma.
        part: a stretch of the frames; default: all.
        container: FFmpeg's name of the container; default: found from the first bytes.
    """
    av = pyav()
    is_path = isinstance(source, (Path, RemotePath))
    file: Any = source.open("rb") if isinstance(source, RemotePath) else source
    if isinstance(source, Path):  # by its number: FFmpeg takes a name such as img%03d.png for that of many pictures
        file = os.fdopen(os.open(source, os.O_RDONLY), "rb")
    status = os.fstat(file.fileno()) if isinstance(source, Path) else None
    try:
        if not is_path and not file.seekable():
            file = _seekable_where_needed(file)
        film = FirstFilm(file, part is None)
        try:
            opened = opened_video(film, container)
        except OSError as error:
            if isinstance(error, av.FFmpegError) or error.errno != errno.EINVAL or not file.seekable():
                raise
            file.seek(0)  # a cut file was asked for a place before its begin, where an index should be
            film = FirstFilm(Prefixed(b"", file))
            opened = opened_video(film, container)
        return _stream(av, opened, film, name, colour, part, source if is_path else None, status)
    except BaseException as error:
        file.close()
        if isinstance(error, FileError) or not isinstance(error, (av.FFmpegError, ValueError)):
            raise
        raise FileError(_UNKNOWN) from error


def _seekable_where_needed(file: BinaryIO) -> BinaryIO:
    """Spool MP4 whose index is behind its frames to a seekable file; all else is read as a stream, maybe a live one."""
    head = read_bytes(file, 12)
    at, kind, boxes = 0, bytes(head[4:8]), 0
    while kind not in (b"moov", b"mdat") and head[4:8] == b"ftyp":  # boxes of ISO 14496-12: size, kind, content
        size = int.from_bytes(head[at : at + 4], "big")
        at += size
        require_at_most(MOST_BYTES, at)
        head += read_bytes(file, at + 8 - len(head))
        kind, boxes = bytes(head[at + 4 : at + 8]), boxes + 1
        if size < 8 or len(kind) < 4 or boxes > _MOST_BOXES:
            raise FileError(_UNKNOWN)
    stream = Prefixed(bytes(head), file)
    if kind != b"mdat":
        return stream  # type: ignore[return-value]
    with contextlib.ExitStack() as opened:
        spool = opened.enter_context(tempfile.TemporaryFile())
        while piece := stream.read(_PIECE):
            if spool.tell() + len(piece) > _MOST_SPOOLED:
                most = f"{_MOST_SPOOLED >> 20} MiB"
                raise FileError(f"an index behind more than {most}, allowed: a file, or an index before the frames")
            spool.write(piece)
        spool.seek(0)
        opened.pop_all()  # the stream closes it
    return spool


class Prefixed:
    """A stream whose first bytes have been read already."""

    def __init__(self, head: bytes, rest: BinaryIO) -> None:
        self.count, self.first = 0, b""  # bytes read, and the first of them
        self._head = io.BytesIO(head)
        self._rest = rest

    def read(self, size: int = -1) -> bytes:
        head = self._head.read(size)
        if size < 0:
            return self._noted(head + self._rest.read())
        return self._noted(head or self._rest.read(size))

    def _noted(self, data: bytes) -> bytes:
        self.count += len(data)
        if len(self.first) < HEAD_BYTES:
            self.first += data[: HEAD_BYTES - len(self.first)]
        return data

    def seekable(self) -> bool:
        return False

    def close(self) -> None:
        self._rest.close()


def _stream(
    av: Any, container: Any, file: Any, name: str, colour: bool, part: Part | None, path: Any, status: Any
) -> RecordingStream:
    def close() -> None:
        container.close()
        file.close()

    stream = None if container.format.name in _REFUSED_CONTAINERS else container.streams.best("video")
    context = getattr(stream, "codec_context", None)
    if stream is None or context is None:  # a codec unknown to this FFmpeg
        close()
        raise FileError(_UNKNOWN)
    pixels = context.width * context.height
    if not 0 < pixels <= _MAX_PIXELS:
        close()
        raise FileError(f"absurd size: frames of {context.width} x {context.height}" if pixels else _UNKNOWN)
    stream.thread_type = "AUTO"
    stream.codec_context.thread_count = _decoder_threads.get()
    pixel_format = context.pix_fmt or ""
    values, response = _layout(av, pixel_format, context, colour)
    timed = container.format.name != JPEGS
    rate = float(stream.average_rate) if stream.average_rate and timed else None
    stamps: list[int | None] = []
    form = _format(pixel_format, context, stream.time_base, path, status, bool(container.streams.audio))
    ending = Ending(container, stream, file)
    is_cut = timed and not _further_tracks(container, stream)  # else a whole reading names them
    return RecordingStream(
        _frames(av, container, stream, name, values, part, form, ending, stamps if timed else []),
        "video",
        response,
        rate,
        stream.frames or None,
        close=close,
        key_frames=lambda max_frames: video_key_frames(container, stream, ending, max_frames) if is_cut else None,
        video=form,
        stamps=stamps,
    )


def _format(
    pixel_format: str, context: Any, time_base: Fraction | None, path: Any, status: Any, has_sound: bool
) -> VideoFormat:
    return VideoFormat(
        path,
        status,
        has_sound,
        context.codec.name,
        pixel_format,
        _is_limited(pixel_format, int(context.color_range or 0)),
        _number(context.color_primaries),
        transfer_of(context),
        _number(context.colorspace),
        time_base or Fraction(1, 90_000),
        context.sample_aspect_ratio or None,
    )


def _number(code: Any) -> int:
    return 2 if code is None else int(code)  # 2: unspecified


def _layout(av: Any, name: str, context: Any, colour: bool) -> tuple[Callable[[Any], Frame], LightResponse]:
    """A function that extracts the values of a frame of this pixel format, and their response."""
    # Where the stream states no range, YUV is limited by convention; grey is assumed full (sensor values).
    stated = int(context.color_range or 0)
    limited = _is_limited(name, stated)
    bits = av.VideoFormat(name).components[0].bits if name else 8
    is_float = name.startswith(FLOAT_GREY)
    if (colour and not is_float) or not (_LUMA_PLANE.match(name) or name in _PACKED_LUMA):
        convert = Conversion(rgb_format(bits > 8), _number(context.colorspace), limited)
        return lambda frame: convert(frame).to_ndarray(), response_of_video(context, 0.0, rgb_white(limited, bits))
    shift = 16 - bits if _UPPER_BITS.match(name) else 0
    unit = 2.0 ** (bits - 8 + shift)  # black at 16 and white at 235 of limited range: ITU-R BT.709, BT.2100
    dark, white = (16 * unit, 235 * unit) if limited else (0.0, (2.0**bits - 1) * 2.0**shift)
    stated_range = ("limited range" if limited else "full range") if stated in (_LIMITED_RANGE, _FULL_RANGE) else ""
    response = response_of_video(context, *((0.0, None) if is_float else (dark, white, stated_range)))
    dtype = np.dtype(f"{'>' if name.endswith('be') else '<'}{'f' if is_float else 'u'}{1 << (bits > 8) + (bits > 16)}")
    first = _PACKED_LUMA.get(name)
    step = 1 if first is None and not name.startswith(("y2", "ya")) else 2

    def luma(frame: Any) -> Frame:
        return _luma(frame, dtype, first or 0, step)

    return (lambda frame: np.dstack([luma(frame)] * 3)) if colour else luma, response


def _is_limited(name: str, stated: int) -> bool:
    return stated == _LIMITED_RANGE or not (stated == _FULL_RANGE or name.startswith(_USUALLY_FULL))


def _luma(frame: Any, dtype: np.dtype[Any], first: int, step: int) -> Frame:
    """The luma of plane 0, contiguous: in the decoder's memory where its lines follow each other, else a copy.

    The array keeps its frame, so the decoder does not reuse that memory; it may still predict other frames from it,
    hence nobody may write.
    """
    if frame.planes[0].line_size < 0:
        frame = downward(frame)
    plane, size = frame.planes[0], dtype.itemsize
    values: Frame = np.ndarray(
        (frame.height, frame.width), dtype, plane, offset=first * size, strides=(plane.line_size, step * size)
    )
    luma = np.ascontiguousarray(values, dtype=dtype.newbyteorder("="))
    luma.flags.writeable = False
    return luma


def _frames(
    av: Any,
    container: Any,
    stream: Any,
    name: str,
    values: Callable[[Any], Frame],
    part: Part | None,
    form: VideoFormat,
    ending: Ending,
    stamps: list[int | None],
) -> Iterator[Frame]:
    if part is not None:
        yield from _part_frames(av, container, stream, values, part)
        return
    count = damaged = 0
    try:
        with ffmpeg():
            for frame in ending.decoded():
                if frame.is_corrupt:
                    damaged += 1
                    continue
                _require_progressive(frame)
                count += 1
                stamps.append(frame.pts)
                if count == 1 and (turn := frame.side_data.get("DISPLAYMATRIX")) is not None:
                    form.display_matrix = struct.unpack("=9i", bytes(turn))
                form.decoded.append((values(frame), frame))
                yield form.decoded[-1][0]
    except av.FFmpegError as error:
        if count == 0:
            raise FileError("no frame that can be decoded") from error
        damaged += 1
    if count == 0:
        raise FileError("no frame that can be decoded")
    last = next((stamp for stamp in reversed(stamps) if stamp is not None), None)
    end = None if last is None or stream.time_base is None else float(last * stream.time_base)
    if damaged or ending.is_early(count, end):
        announced = f" of {stream.frames}" if stream.frames else ""
        message = f"{name}: truncated or damaged video: {count}{announced} frames are whole"
        if ending.has_another_film:
            message = f"{name}: a further {ending.kind} after the first, which is left out"
        warnings.warn(message, FileWarning, stacklevel=2)
    if further := _further_tracks(container, stream):
        message = f"{name}: video track {stream.index} is read, {further} more left out"
        warnings.warn(message, FileWarning, stacklevel=2)


def _part_frames(av: Any, container: Any, stream: Any, values: Callable[[Any], Frame], part: Part) -> Iterator[Frame]:
    try:
        with ffmpeg():
            for frame in decoded_part(container, stream, part):
                _require_progressive(frame)
                yield values(frame)
    except av.FFmpegError as error:
        raise FileError("a stretch that cannot be decoded") from error


def _further_tracks(container: Any, stream: Any) -> int:
    """Number of video tracks beside that of ``stream``, without pictures that belong to the film, such as its cover."""
    tracks = [track for track in container.streams.video if track.index != stream.index]
    return sum(not int(getattr(track, "disposition", 0)) & _ATTACHED_PICTURE for track in tracks)


def _require_progressive(frame: Any) -> None:
    if frame.interlaced_frame:
        raise FileError(_INTERLACED)
