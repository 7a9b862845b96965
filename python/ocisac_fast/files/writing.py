"""Atomic writing of recordings."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from ocisac_fast.core.checks import checked, shown
from ocisac_fast.files.extras import pillow, pyav
from ocisac_fast.files.recording import FileError, Frame, RecordingStream
from ocisac_fast.files.video_writing import CODECS, check_frame, write_video

_PICTURES = {".png": "PNG", ".tif": "TIFF", ".tiff": "TIFF", ".jpg": "JPEG", ".jpeg": "JPEG"}
_JPEG: dict[str, Any] = {"quality": 95, "subsampling": 0}
_MAX_SUFFIX = 16  # bytes; no supported kind of file has a longer one


@checked
@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path with the suffix of ``path``; it replaces ``path`` on success and is removed on an error.

    Links are followed. An existing file keeps its mode and, where permitted, its owner; a file without write permission
    is rejected. A target that is not a regular file, such as a FIFO or a device, receives all bytes at the end.
    """
    target = Path(os.path.realpath(path))
    there = _status(Path(path))
    if there is not None and stat.S_ISDIR(there.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    if there is not None and not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), os.fspath(path))
    is_file = there is None or stat.S_ISREG(there.st_mode)
    folder = target.parent if is_file else Path(tempfile.gettempdir())
    if not folder.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such directory to write to", str(Path(path).parent))
    suffix = Path(path).suffix
    # A short name for any length of `path`; created like open() does, so that the umask applies to new files.
    temporary = folder / f".{secrets.token_hex(8)}{suffix if len(os.fsencode(suffix)) <= _MAX_SUFFIX else ''}"
    os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600 if there else 0o666))
    try:
        yield temporary
        if not is_file:
            with temporary.open("rb") as whole, open(path, "wb") as sink:
                shutil.copyfileobj(whole, sink)
            temporary.unlink()
            return
        if there is not None:
            with contextlib.suppress(PermissionError):
                os.chown(temporary, there.st_uid, there.st_gid)
            temporary.chmod(stat.S_IMODE(there.st_mode))
        with temporary.open("rb") as whole:
            os.fsync(whole.fileno())  # before its name: no crash leaves a name without its bytes
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _status(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except FileNotFoundError:
        return None


@checked
def write_frames(
    path: str | os.PathLike[str],
    frames: Iterable[Frame],
    *,
    frame_rate: float = 30.0,
    like: RecordingStream | None = None,
) -> None:
    """Write frames atomically, and losslessly except for JPEG; the suffix selects the kind of file.

    Args:
        path: ``.png`` (one frame), ``.jpg``/``.jpeg`` (one of 8 bits, quality 95), ``.tif``/``.tiff`` (one page per
            frame), ``.mkv`` (FFV1), ``.mp4`` (lossless H.264, 8 bits) or ``.npy`` (any type). The directory must exist.
        frames: any iterable of (rows, columns) or (rows, columns, 3), all of one shape and type, such as an array
            (frames, rows, columns); an array (rows, columns) is one frame, and .npy keeps this shape. uint8 or uint16;
            also float32 for TIFF and .npy, float64 for .npy.
        frame_rate: frames per second of a video, above 0.
        like: the open video of which these are the processed frames, in order: its sound, its time stamps and what it
            states of range and colours are kept. Colours can then be written as ``.mp4`` too, with the video's
            subsampling (H.264, crf 10).

    Raises:
        FileError: a ValueError: an unknown suffix, no frame, or a type or shape that the kind of file cannot hold.
        OSError: the file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    single = isinstance(frames, np.ndarray) and frames.ndim == 2
    if single:
        frames = [np.asarray(frames)]
    try:
        with atomic_path(path) as temporary:
            if suffix == ".npy":
                every = _alike(frames)
                with temporary.open("wb") as file:
                    np.save(file, every[0] if single else np.stack(every), allow_pickle=False)
            elif suffix in _PICTURES:
                _write_picture(temporary, _alike(frames), _PICTURES[suffix])
            elif suffix in CODECS:
                write_video(temporary, frames, frame_rate, like)
            else:
                allowed = ", ".join([*_PICTURES, *CODECS, ".npy"])
                raise FileError(f"suffix: got {shown(suffix)}, allowed: {allowed}")
    except FileError as error:
        raise FileError(f"{os.fspath(path)}: {error}") from error.__cause__


def _alike(frames: Iterable[Frame]) -> list[Frame]:
    every = [np.asarray(frame) for frame in frames]
    if not every:
        raise FileError("frames: no frame to write")
    if any(frame.shape != every[0].shape or frame.dtype != every[0].dtype for frame in every):
        raise FileError("frames of different shapes or types")
    return every


def _write_picture(path: Path, frames: list[Frame], kind: str) -> None:
    first = frames[0]
    types = (
        {"TIFF": (np.uint8, np.uint16, np.float32), "JPEG": (np.uint8,)} if first.ndim == 2 or kind == "JPEG" else {}
    )
    check_frame(first, types.get(kind, (np.uint8, np.uint16)))
    if len(frames) > 1 and kind != "TIFF":
        raise FileError(f"{len(frames)} frames, a {kind} picture holds one (use .tif, .mkv or .npy)")
    if first.ndim == 3 and first.dtype == np.uint16:  # Pillow has no 16-bit colour
        if len(frames) > 1:
            raise FileError("several frames of 16-bit colour (use .mkv or .npy)")
        codec, pixels = ("png", "rgb48be") if kind == "PNG" else ("tiff", "rgb48le")
        path.write_bytes(b"".join(bytes(packet) for packet in _encode(frames, codec, pixels, Fraction(25), {})))
        return
    images = [pillow().fromarray(np.ascontiguousarray(frame)) for frame in frames]
    options = {"save_all": True, "append_images": images[1:]} if len(images) > 1 else _JPEG if kind == "JPEG" else {}
    images[0].save(path, kind, **options)


def _encode(frames: Iterable[Frame], codec: str, pixels: str, rate: Fraction, options: dict[str, str]) -> Iterator[Any]:
    """Encode frames to packets, without a container."""
    av = pyav()
    context = None
    for frame in frames:
        if context is None:
            context = av.CodecContext.create(codec, "w")
            context.height, context.width = frame.shape[:2]
            context.pix_fmt, context.time_base, context.options = pixels, 1 / rate, options
        yield from context.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format=pixels))
    if context is not None:
        yield from context.encode(None)
