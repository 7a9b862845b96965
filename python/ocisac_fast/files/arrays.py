"""NumPy's .npy files."""

from __future__ import annotations

import contextlib
import math
import os
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ocisac_fast.files.parts import counted, every_frame
from ocisac_fast.files.raw import read_bytes
from ocisac_fast.files.recording import FileError, Frame, LightResponse, Part, RecordingStream
from ocisac_fast.files.remote import RemotePath
from ocisac_fast.files.videos import Prefixed

MAGIC = b"\x93NUMPY"
# MemoryError: of the parser, whose stack a nested header fills.
_DAMAGED = (ValueError, SyntaxError, TypeError, OverflowError, RecursionError, MemoryError, tokenize.TokenError)


def open_array(path: Path | RemotePath, part: Part | None = None) -> RecordingStream:
    """Open a .npy file; frames are read on demand.

    (rows,) is one column, (rows, columns) one frame, (frames, rows, columns) several and
    (frames, rows, columns, colours) several in colour. Pickled objects are rejected. The file is read, not mapped:
    truncation of a mapped file by another process would end this one (SIGBUS).
    """
    with contextlib.ExitStack() as opened:
        file = opened.enter_context(path.open("rb"))
        header = _read_header(file)
        begin = file.tell()
        size, need = file.seek(0, os.SEEK_END), begin + header.bytes
        if need > size:
            raise FileError(f"truncated: {size} bytes, its header announces {need}")
        if need < size and part is None:  # arrays one after the other, as in a pipe
            file.seek(0)
            opened.pop_all()
            return stream_arrays(file)
        file.seek(begin + (0 if part is None else header.frame_bytes * part.first))
        opened.pop_all()
    count = header.frame_count
    frames = _array_frames(file, header, count if part is None else part.stop - part.first)
    return RecordingStream(
        frames if part is None else counted(part, frames),
        "array",
        LightResponse(assumed_for=".npy"),
        frame_count=count,
        close=file.close,
        key_frames=lambda max_frames: every_frame(count, max_frames) if header.several else None,
    )


def stream_arrays(file: BinaryIO) -> RecordingStream:
    """Stream the frames of .npy files that arrive through a pipe, one after the other."""
    first = _read_header(file)
    return RecordingStream(_streamed(file, first), "array", LightResponse(assumed_for=".npy"), close=file.close)


@dataclass(frozen=True, slots=True)
class _Header:
    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype[Any]

    @property
    def bytes(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def several(self) -> bool:
        """True if the frames follow each other in the file; else all of it is one piece."""
        return len(self.shape) > 2 and not self.fortran_order

    @property
    def frame_count(self) -> int:
        return self.shape[0] if len(self.shape) > 2 else 1

    @property
    def frame_bytes(self) -> int:
        return self.bytes // self.frame_count


def _read_header(stream: BinaryIO) -> _Header:
    """Read a header; an array that is not numeric is rejected before memory is allocated."""
    try:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        header = _Header(*read(stream))
    except _DAMAGED as error:
        raise FileError(f"damaged .npy file ({' '.join(str(error).split())})") from error
    if header.dtype.kind not in "buif":
        raise FileError(f"array of {header.dtype}, allowed: real numbers")
    if not 1 <= len(header.shape) <= 4 or min(header.shape) < 1:
        raise FileError(f"array of shape {header.shape}, allowed: [frames,] rows, columns [, colours], none of them 0")
    return header


def _streamed(file: BinaryIO, header: _Header) -> Iterator[Frame]:
    while True:
        yield from _array_frames(file, header, header.frame_count)
        head = read_bytes(file, len(MAGIC))
        if not head:
            return
        if bytes(head) != MAGIC:
            raise FileError("after the array: bytes that are no .npy file")
        header = _read_header(Prefixed(bytes(head), file))  # type: ignore[arg-type]


def _array_frames(file: BinaryIO, header: _Header, count: int) -> Iterator[Frame]:
    """The next frames in order; where the first axis is not the slowest, all of them after all data has arrived."""
    several = header.several
    shape = header.shape[1:] if several else header.shape
    size = math.prod(shape) * header.dtype.itemsize
    for index in range(count if several else 1):
        data = read_bytes(file, size)
        if len(data) < size:
            got = index * size + len(data)
            raise FileError(f"truncated: {got} bytes of numbers, its header announces {header.bytes}")
        values = np.frombuffer(data, header.dtype).reshape(shape, order="F" if header.fortran_order else "C")
        yield from [values] if several else _as_frames(values)


def _as_frames(array: Frame) -> Frame:
    if array.ndim == 1:
        return array[np.newaxis, :, np.newaxis]
    return array[np.newaxis] if array.ndim == 2 else array
