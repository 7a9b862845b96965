"""Reading recordings: the first bytes of a file determine its kind, not its name."""

from __future__ import annotations

import contextlib
import os
import stat
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from ocisac_fast.core.checks import checked
from ocisac_fast.files.arrays import MAGIC, open_array, stream_arrays
from ocisac_fast.files.parts import JPEGS, parts_between
from ocisac_fast.files.pictures import JPEG, TIFF, are_jpegs, is_picture, most_bytes, next_jpeg, open_picture
from ocisac_fast.files.raw import RawFormat, open_raw, read_whole, require_at_most, standard_input
from ocisac_fast.files.recording import FileError, Frame, Part, Recording, RecordingStream, naming
from ocisac_fast.files.remote import RemotePath, is_remote
from ocisac_fast.files.videos import FLOAT_GREY, Prefixed, open_video

STANDARD_INPUT = "-"
_HEAD, _PIECE = 16, 1 << 16
_FIRST_JPEGS = 64 << 20  # bytes in which a second one begins
_MAX_BYTES = 4 << 30
_SAMPLES, _SAMPLE_BYTES = 8, 4096  # of a file, to tell growth from another content


@checked
def read_frames(
    path: str | os.PathLike[str], *, colour: bool = False, raw: str | None = None, max_bytes: int = _MAX_BYTES
) -> Recording:
    """Read all frames of a picture, a video or a .npy array.

    Args:
        path: PNG, JPEG, TIFF, PNM, BMP, WebP (pages and animations are frames); any video that FFmpeg decodes; .npy of
            (rows,), (rows, columns), (frames, rows, columns) or (frames, rows, columns, colours); ``"-"``: standard
            input. Pictures need Pillow (and PyAV for 16-bit colour), videos PyAV: ``ocisac-fast[files]``.
        colour: red, green and blue of a video instead of its luma plane.
        raw: frames without a header, ``"WIDTHxHEIGHT"`` (of bytes), ``"...:gray8"`` or ``"...:gray16le"``.
        max_bytes: larger recordings are rejected; read them with ``open_recording``.

    Returns:
        ``Recording``: values as stored (uint8, uint16, ...), with the range and tone curve that the file states.

    Raises:
        FileError: a ValueError: empty, truncated, damaged, absurdly large, or none of these kinds.
        OSError: the file is missing, a directory, or not permitted.
    """
    with open_recording(path, colour=colour, raw=raw) as stream, naming(name_of(path), None):
        return stream.read(max_bytes)


@checked
def open_recording(
    path: str | os.PathLike[str], *, colour: bool = False, raw: str | None = None, part: Part | None = None
) -> RecordingStream:
    """Open a recording for reading frame by frame; memory holds a few frames, whatever the length.

    A pipe or standard input may carry raw frames or several .npy files in sequence; each frame is available once it is
    complete.

    Arguments and errors as in ``read_frames``. Use it in a ``with`` statement and iterate once.

    Args:
        part: a stretch from ``cut_recording``; default: all frames.
    """
    name, kept = name_of(path), _Kept(os.fspath(path))
    form = None if raw is None else RawFormat.parse(raw)
    with naming(name, None):
        if form is not None:
            file = standard_input() if os.fspath(path) == STANDARD_INPUT else _place(path).open("rb")
            stream = open_raw(file, form, part)
        elif os.fspath(path) == STANDARD_INPUT:
            stream = _of_stream(standard_input(), name, colour)
        else:
            stream = _of_file(_place(path), name, colour, part)
    return stream.map_frames(lambda frames: _of_one_recording(name, kept, frames))


@checked
def cut_recording(path: str | os.PathLike[str], max_frames: int, *, raw: str | None = None) -> list[Part] | None:
    """Cut a recording into stretches of about ``max_frames`` frames that ``open_recording`` reads by themselves.

    A video is cut at key frames, so stretches may be longer; its packets are read, not decoded. Arrays and raw frames
    are cut anywhere.

    Returns:
        The stretches in order; None for one that is short or cannot be cut: a picture, a pipe, a damaged or truncated
        video, one without key frames or time stamps.
    """
    if os.fspath(path) == STANDARD_INPUT:
        return None
    with open_recording(path, raw=raw) as stream:
        key_frames = stream.key_frames(max_frames)
    return None if key_frames is None else parts_between(key_frames, max_frames)


@checked
def lossless_suffix(path: str | os.PathLike[str], *, raw: str | None = None) -> str:
    """Suffix of the kind of file that holds a recording's processed frames, and what a picture states, without loss.

    Arguments and errors as in ``read_frames``.
    """
    with open_recording(path, raw=raw) as stream:
        kind, is_single, film = stream.kind, stream.frame_count == 1, stream.video
    if kind != "picture":
        is_float = film is not None and film.pixel_format.startswith(FLOAT_GREY)
        return ".npy" if kind == "array" or is_float else ".mkv"
    with _place(path).open("rb") as file:
        is_tiff = file.read(len(TIFF[0])) in TIFF
    return ".tif" if is_tiff else ".png" if is_single else ".mkv"


def _place(path: str | os.PathLike[str]) -> Path | RemotePath:
    if is_remote(os.fspath(path)):
        return RemotePath(os.fspath(path))
    there = os.stat(path)  # refuses "file/", whose slash Path leaves out
    if stat.S_ISREG(there.st_mode) and there.st_size == 0:  # also of /proc, where a file may have no end
        raise FileError("empty file")
    return Path(path)


def _of_file(path: Path | RemotePath, name: str, colour: bool, part: Part | None) -> RecordingStream:
    if isinstance(path, Path):
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):  # a pipe or a device cannot be rewound
            with contextlib.ExitStack() as opened:
                stream = _of_stream(opened.enter_context(path.open("rb")), name, colour)
                opened.pop_all()
                return stream
    with path.open("rb") as file:
        head = file.read(_HEAD)
        if not head:
            raise FileError("empty file")
        if head.startswith(MAGIC):
            return open_array(path, part)
        if not is_picture(head):
            return open_video(path, name, colour, part)
        if head.startswith(JPEG) and are_jpegs(head + file.read(_FIRST_JPEGS)):
            return open_video(path, name, colour, part, container=JPEGS)
        return open_picture(read_whole(file, most_bytes(head)))


def _of_stream(file: BinaryIO, name: str, colour: bool) -> RecordingStream:
    head = file.read(_HEAD)
    if not head:
        raise FileError("empty")
    if head.startswith(MAGIC):
        return stream_arrays(Prefixed(head, file))  # type: ignore[arg-type]
    if is_picture(head):
        return _of_pictures(head, file, name, colour)
    return open_video(_redirected(file, len(head)) or Prefixed(head, file), name, colour)  # type: ignore[arg-type]


def _redirected(file: BinaryIO, read: int) -> Path | None:
    """The file that standard input was redirected to, which can be opened again, for its sound; None: a pipe."""
    with contextlib.suppress(OSError):  # io.UnsupportedOperation is one
        path = Path(f"/dev/fd/{file.fileno()}")
        if stat.S_ISREG(os.fstat(file.fileno()).st_mode) and file.tell() == read and os.access(path, os.R_OK):
            file.seek(0)
            return path
    return None


def _of_pictures(head: bytes, file: BinaryIO, name: str, colour: bool) -> RecordingStream:
    """A picture, or JPEGs one after the other, each as soon as it is complete."""
    data, at, is_whole, follows = bytearray(head), 2, False, False
    while piece := file.read1(_PIECE):  # type: ignore[attr-defined]
        data += piece
        if data.startswith(JPEG):
            at, is_whole, follows = next_jpeg(data, at, is_whole)
        if follows:
            return open_video(Prefixed(bytes(data), file), name, colour, container=JPEGS)  # type: ignore[arg-type]
        require_at_most(most_bytes(head), len(data))
    return open_picture(bytes(data))


def name_of(path: str | os.PathLike[str]) -> str:
    return "standard input" if os.fspath(path) == STANDARD_INPUT else os.fspath(path)


class _Kept:
    """A file as it is when this is made, and stays open: its name may lead to another one later. None else changes."""

    def __init__(self, path: str) -> None:
        self._path, self._is_remote, self._number = path, False, -1
        with contextlib.suppress(OSError, ValueError):
            self._is_remote = is_remote(path)
            place = sys.stdin.buffer.fileno() if path == STANDARD_INPUT else path
            if stat.S_ISREG(os.stat(place).st_mode):  # opening a pipe could wait
                self._number = os.dup(place) if isinstance(place, int) else os.open(place, os.O_RDONLY)
        self._before = self._state()

    def __del__(self) -> None:
        if self._number >= 0:
            os.close(self._number)

    def is_changed(self) -> bool:
        """True if it was overwritten or cut, remotely also if it grew: here one that grows is still being recorded.

        Samples leave out the beginning, where films have lengths that are written as they end.
        """
        after = self._before and self._state(self._before[0])
        if not (self._before and after):
            return False
        (size, time, samples), (size_now, time_now, samples_now) = self._before, after
        return samples_now != samples or (time_now != time and size_now <= size)

    def _state(self, length: int | None = None) -> tuple[int, Any, list[bytes]] | None:
        """Length and time of change, and samples of the first ``length`` bytes."""
        with contextlib.suppress(OSError, ValueError):
            if self._is_remote:
                return 0, RemotePath(self._path).state, []
            there = os.fstat(self._number)
            size = there.st_size if length is None else length
            starts = (size * (2 * k + 1) // (2 * _SAMPLES) for k in range(_SAMPLES))
            samples = [os.pread(self._number, min(_SAMPLE_BYTES, size - start), start) for start in starts]
            return there.st_size, there.st_mtime_ns, samples
        return None


def _of_one_recording(name: str, kept: _Kept, frames: Iterator[Frame]) -> Iterator[Frame]:
    """Refuse frames of several shapes or types, and a file that was changed meanwhile."""
    with naming(name, None):
        first: Any = None
        count = 0
        for frame in frames:
            kind = (frame.shape, frame.dtype)
            first = first or kind
            if kind != first:
                differs = int(frame.shape == first[0])
                raise FileError(f"frame {count} is {kind[differs]} after frames of {first[differs]}")
            yield frame
            count += 1  # noqa: SIM113, `enumerate` would hold the frame
            del frame  # before the next one is made
        if kept.is_changed():
            raise FileError("changed while it was read: its frames may be of two recordings")
