"""Frames without headers, in sequence, as a camera's pipe delivers them."""

from __future__ import annotations

import io
import itertools
import os
import re
import select
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

from ocisac_fast.core.checks import shown
from ocisac_fast.files.parts import counted, every_frame
from ocisac_fast.files.recording import FileError, FileWarning, Frame, KeyFrames, LightResponse, Part, RecordingStream

_FORMATS: dict[str, np.dtype[Any]] = {"gray8": np.dtype("u1"), "gray16le": np.dtype("<u2")}
_FORMAT = re.compile(r"(\d{1,6})x(\d{1,6})(?::(\w+))?")
_PIECE = 1 << 24  # bytes per read: the announced size may be absurd
MOST_BYTES = 64 << 20  # of a file that is no recording, and read whole
_MOST_FRAME_BYTES = 4 << 30


@dataclass(frozen=True, slots=True)
class RawFormat:
    """Frames of ``height`` rows of ``width`` pixels of ``dtype``, without padding."""

    width: int
    height: int
    dtype: np.dtype[Any]

    @classmethod
    def parse(cls, text: str) -> RawFormat:
        """``WIDTHxHEIGHT``, ``WIDTHxHEIGHT:gray8`` or ``WIDTHxHEIGHT:gray16le``.

        Raises:
            ValueError: any other text.
        """
        match = _FORMAT.fullmatch(text.strip())
        name = match[3] or "gray8" if match else ""
        if match is None or name not in _FORMATS or 0 in (int(match[1]), int(match[2])):
            raise ValueError(f"raw: got {shown(text)}, allowed: WIDTHxHEIGHT[:gray8|gray16le], such as 1920x1080:gray8")
        return cls(int(match[1]), int(match[2]), _FORMATS[name])

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame."""
        return self.width * self.height * self.dtype.itemsize


def open_raw(file: BinaryIO, form: RawFormat, part: Part | None = None) -> RecordingStream:
    """Stream frames to the end of the stream; a partial frame at the end is dropped with a warning."""

    def key_frames(max_frames: int) -> KeyFrames | None:
        count, left = divmod(file.seek(0, os.SEEK_END), form.frame_bytes)
        return None if left else every_frame(count, max_frames)

    frames = _frames(file, form)
    if part is not None:
        file.seek(part.first * form.frame_bytes)
        frames = counted(part, itertools.islice(frames, part.stop - part.first))
    response = LightResponse(assumed_for="raw frames")
    return RecordingStream(frames, "video", response, close=file.close, key_frames=key_frames)


def _frames(file: BinaryIO, form: RawFormat) -> Iterator[Frame]:
    count = 0
    while data := read_bytes(file, form.frame_bytes):
        if len(data) < form.frame_bytes:
            left = f"{len(data)} bytes after {count} frames of {form.frame_bytes}"
            if count == 0:
                raise FileError(f"truncated: {left}")
            warnings.warn(f"{left} were left out", FileWarning, stacklevel=2)
            return
        yield np.frombuffer(data, form.dtype).reshape(form.height, form.width)
        count += 1
    if count == 0:
        raise FileError("empty")


class _Waiting(io.FileIO):
    """Standard input that another process made non-blocking: a pause of the writer is no end."""

    def readinto(self, buffer: Any) -> int:
        while (count := super().readinto(buffer)) is None:
            select.select([self], [], [])
        return count

    read: Any = io.RawIOBase.read  # by `readinto`, as the next
    readall = io.RawIOBase.readall


def standard_input() -> BinaryIO:
    """Standard input, of which a read waits for data. FileError: it was read before."""
    if sys.stdin.buffer.closed:
        raise FileError("was read before, allowed: once")
    first = sys.__stdin__
    if first is not None and sys.stdin is first and not os.get_blocking(first.fileno()):
        sys.stdin = io.TextIOWrapper(io.BufferedReader(_Waiting(first.fileno(), closefd=False)))
    return sys.stdin.buffer


def require_at_most(most: int, count: int) -> None:
    """Raise FileError for more bytes of a file or a frame that is read whole than are allowed."""
    if count > most:
        raise FileError(f"more than {most >> 20} MiB, allowed: at most these")


def read_whole(file: BinaryIO, most: int = MOST_BYTES) -> bytes:
    """All bytes of a file, a pipe or a device.

    Raises:
        FileError: more than ``most``.
    """
    size = file.seek(0, os.SEEK_END) if file.seekable() else 0  # 0 too of a device, which may have no end
    if size:
        file.seek(0)
    require_at_most(most, size)
    data = file.read(size) if size else bytes(read_bytes(file, most + 1))
    require_at_most(most, len(data))
    return data


def read_bytes(file: BinaryIO, count: int) -> bytearray:
    """Read ``count`` bytes, or fewer at the end of the stream.

    Raises:
        FileError: more than a frame may have.
    """
    require_at_most(_MOST_FRAME_BYTES, count)
    data = bytearray()
    while len(data) < count and (piece := file.read(min(count - len(data), _PIECE))):
        data += piece
    return data
