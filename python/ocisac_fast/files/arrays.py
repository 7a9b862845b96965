"""NumPy's .npy files."""

from __future__ import annotations

import io
import math
import tokenize
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ocisac_fast.files.recording import FileError, Frame, LightResponse, RecordingStream

MAGIC = b"\x93NUMPY"


def open_array(source: Path | bytes) -> RecordingStream:
    """The frames of a .npy file, mapped into memory, or of its bytes.

    (rows,) is one column, (rows, columns) one frame, (frames, rows, columns) several and
    (frames, rows, columns, channels) several in colour. Pickled objects are refused.
    """
    if isinstance(source, Path):
        with source.open("rb") as stream:
            _check_header(stream, source.stat().st_size)
        array = np.load(source, mmap_mode="r", allow_pickle=False)
    else:
        _check_header(io.BytesIO(source), len(source))
        array = np.load(io.BytesIO(source), allow_pickle=False)
    return RecordingStream.of_array(_as_frames(array), "array", LightResponse())


def _check_header(stream: BinaryIO, size: int) -> None:
    """Refuse an array that is not numbers, or shorter than its header says, before any memory is asked for."""
    try:
        version = np.lib.format.read_magic(stream)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = header(stream)
    except (ValueError, SyntaxError, TypeError, OverflowError, tokenize.TokenError) as error:
        raise FileError(f"damaged .npy file ({' '.join(str(error).split())})") from error
    if dtype.kind not in "buif":
        raise FileError(f"array of {dtype}, allowed: real numbers")
    if not 1 <= len(shape) <= 4 or min(shape) < 1:
        raise FileError(f"array of shape {shape}, allowed: [frames,] rows, columns [, channels], none of them 0")
    need = stream.tell() + math.prod(shape) * dtype.itemsize
    if need > size:
        raise FileError(f"truncated: {size} bytes, its header announces {need}")


def _as_frames(array: Frame) -> Frame:
    if array.ndim == 1:
        return array[np.newaxis, :, np.newaxis]
    return array[np.newaxis] if array.ndim == 2 else array
