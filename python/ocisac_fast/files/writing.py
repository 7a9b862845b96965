"""Atomic writing of recordings."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import itertools
import math
import os
import re
import secrets
import shutil
import stat
import tempfile
import types
from collections.abc import Iterable, Iterator, Mapping
from contextvars import ContextVar
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from ocisac_fast.core.checks import checked, shown
from ocisac_fast.files.extras import pillow, pyav
from ocisac_fast.files.pictures import ORIENTATION
from ocisac_fast.files.recording import FileError, Frame, PictureFormat, RecordingStream, naming
from ocisac_fast.files.video_writing import CODECS, check_frame, write_video

_PICTURES = {".png": "PNG", ".tif": "TIFF", ".tiff": "TIFF", ".jpg": "JPEG", ".jpeg": "JPEG"}
_JPEG: dict[str, Any] = {"quality": 95, "subsampling": 0}
_PNG_HEADER = 33  # bytes of the signature and of IHDR
_MAX_SUFFIX = 16  # bytes; no supported kind of file has a longer one
_USUAL_FOLDERS = 3  # of writers of one file at a time, which the next one removes if they were killed
# Path of a file that is being written, here or in a folder of results, or of its folder.
TEMPORARY = re.compile(r"(?:.*/)?\.[0-9a-f]{16}(?:/new)?(?:\.[^/]*)?", re.DOTALL)
_places: ContextVar[Mapping[str, _Place]] = ContextVar("places", default=types.MappingProxyType({}))


class _Place:
    """Where an output goes, fixed when this is made: its folder, whatever the name of that becomes, and its name there.

    Links are followed as the system does, by which a ``missing/..`` is no folder: the file that is written is the one
    that checks of the path see. What is not a regular file, such as a FIFO or a device, is written to at the end.

    Raises:
        OSError: a folder, in none, or without write permission.
    """

    def __init__(self, path: str | os.PathLike[str], is_new: bool = False) -> None:
        self.path = os.fspath(path)
        there = _status(self.path)
        if there is not None and stat.S_ISDIR(there.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), self.path)
        if there is not None and not os.access(path, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), self.path)
        self.is_file = there is None or stat.S_ISREG(there.st_mode)
        self.is_new = is_new and self.is_file
        target = self.path
        while os.path.islink(target):
            target = os.path.join(os.path.dirname(target), os.readlink(target))
        self._folder, self._name = os.path.split(target)
        try:
            self._folder = (self._folder or os.getcwd()) if self.is_file else tempfile.gettempdir()
            self._descriptor = os.open(self._folder, os.O_DIRECTORY | getattr(os, "O_PATH", os.O_RDONLY))
        except (FileNotFoundError, NotADirectoryError):
            raise FileNotFoundError(errno.ENOENT, "no such directory to write to", self._folder or ".") from None

    def close(self) -> None:
        os.close(self._descriptor)

    def status(self) -> os.stat_result | None:
        """The file that is there now; one of `fixed_outputs` that was not there before is kept."""
        there = _status(self._name, self._descriptor) if self.is_file else None
        if self.is_new and there is not None:
            raise self.appeared()
        return there

    def temporary(self, mode: int) -> _Temporary:
        """A new file in a folder of its own in the folder."""
        suffix = Path(self.path).suffix
        suffix = suffix if len(os.fsencode(suffix)) <= _MAX_SUFFIX else ""
        folder = next(filter(self._is_folder, (f"/proc/self/fd/{self._descriptor}", self._folder)), None)
        if folder is None:
            raise FileNotFoundError(errno.ENOENT, "its folder was moved or removed during this run", self.path)
        try:
            return _Temporary(Path(folder), self._name, suffix, mode)
        except OSError as error:
            raise OSError(error.errno, error.strerror, self.path) from error

    def _is_folder(self, name: str) -> bool:
        """True for a name that the folder still has."""
        with contextlib.suppress(OSError):
            folder = os.fstat(self._descriptor)
            return folder.st_nlink > 0 and os.path.samestat(os.stat(name), folder)
        return False

    def publish(self, temporary: _Temporary) -> None:
        """Give a file its name, unless one that appeared has it; what is not a file gets the bytes."""
        own = temporary.path.name
        here: Any = {"src_dir_fd": temporary.folder, "dst_dir_fd": self._descriptor}
        if not self.is_file:
            with temporary.path.open("rb") as whole, open(os.open(self.path, os.O_WRONLY), "wb") as sink:
                if stat.S_ISREG(os.fstat(sink.fileno()).st_mode):
                    raise self.appeared()
                shutil.copyfileobj(whole, sink)
        elif not self.is_new:
            os.replace(own, self._name, **here)
        else:
            try:
                try:
                    os.link(own, self._name, **here)
                except FileExistsError:
                    raise
                except OSError:  # a file system without links: the name is taken first
                    os.close(os.open(self._name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, dir_fd=self._descriptor))
                    os.replace(own, self._name, **here)
            except FileExistsError as error:
                raise self.appeared() from error

    def appeared(self) -> FileExistsError:
        return FileExistsError(errno.EEXIST, "appeared during this run, and is kept", self.path)


@contextlib.contextmanager
def fixed_outputs(paths: Iterable[str | os.PathLike[str]], *, replace: bool) -> Iterator[None]:
    """Inside, `atomic_path` writes these paths to where they lead now, whatever links and folders become.

    Without ``replace`` no file is replaced, also if it appears while one is written.
    """
    with contextlib.ExitStack() as opened:
        every = (_Place(path, not replace) for path in paths)
        places = {place.path: opened.enter_context(contextlib.closing(place)) for place in every}
        token = _places.set({**_places.get(), **places})
        opened.callback(_places.reset, token)
        yield


@checked
@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path with the suffix of ``path``; it replaces ``path`` on success and is removed on an error.

    Links are followed. An existing file keeps its mode and, where permitted, its owner; a file without write permission
    is rejected, and one that appeared though it is of `fixed_outputs`. A target that is not a regular file, such as a
    FIFO or a device, receives all bytes at the end. Errors of the system name ``path``.
    """
    with _written(path) as temporary, naming(path, None, str(temporary)):
        yield temporary


@contextlib.contextmanager
def _written(path: str | os.PathLike[str]) -> Iterator[Path]:
    """`atomic_path` with errors as they are."""
    with contextlib.ExitStack() as opened:
        held = _places.get().get(os.fspath(path))
        place = opened.enter_context(contextlib.closing(_Place(path))) if held is None else held
        there = place.status()
        mode = 0o600 if there or not place.is_file else 0o666
        temporary = opened.enter_context(contextlib.closing(place.temporary(mode)))
        yield temporary.path
        if there is not None:
            with contextlib.suppress(PermissionError):
                os.fchown(temporary.file, there.st_uid, there.st_gid)
            os.fchmod(temporary.file, stat.S_IMODE(there.st_mode))
        with naming(path, None, temporary.path.name):
            os.fsync(temporary.file)  # before its name: no crash leaves a name without its bytes
            place.publish(temporary)


class _Temporary:
    """A new file in a folder that only its process writes to, locked while it is open, and removed at the end.

    Whoever owns the folder around it can neither exchange the file nor put a link in its place. What a killed process
    left on its way to the same name is removed. Names are short for any ``name``; the file is created like open() does,
    so that the umask applies.
    """

    folder = file = -1  # descriptors

    def __init__(self, around: Path, name: str, suffix: str, mode: int) -> None:
        salts = (bytes([k]) if k else b"" for k in range(_USUAL_FOLDERS))
        usual = [hashlib.blake2b(os.fsencode(name), digest_size=8, salt=salt).hexdigest() for salt in salts]
        self._own = f"new{suffix}"
        for mark in usual:
            with contextlib.suppress(OSError):  # none there, no locks, or its process lives
                self._take(around / f".{mark}", needs_lock=True)
                self.close()
        others = iter(lambda: secrets.token_hex(8), "")  # where processes write the same
        try:  # a signal may come at any time
            for mark in itertools.chain(usual, others):
                self._name = around / f".{mark}"
                with contextlib.suppress(FileExistsError):
                    self._name.mkdir(0o700)
                    with contextlib.suppress(BlockingIOError, FileNotFoundError):  # it was taken for what is left
                        self._take(self._name, needs_lock=False)
                        break
            held = Path(f"/proc/self/fd/{self.folder}")
            self.path = (held if held.exists() else self._name) / self._own
            self.file = os.open(self._own, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode, dir_fd=self.folder)
            if os.fstat(self.file).st_uid != os.fstat(self.folder).st_uid:
                raise PermissionError(errno.EACCES, "its temporary folder was exchanged", name)
        except BaseException:
            self.close()
            raise

    def _take(self, folder: Path, *, needs_lock: bool) -> None:
        """Open and lock a folder that still has its name."""
        self._name = folder
        self.folder = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        try:
            try:
                fcntl.flock(self.folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                if needs_lock or isinstance(error, BlockingIOError):
                    raise
            if not os.path.samestat(os.fstat(self.folder), os.stat(folder, follow_symlinks=False)):
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(folder))
        except OSError:
            self._let_go()
            raise

    def close(self) -> None:
        with contextlib.suppress(OSError):  # it has its name, or there is none yet
            os.unlink(self._own, dir_fd=self.folder)
        with contextlib.suppress(OSError):  # moved, or not of this kind
            self._name.rmdir()
        self._let_go()

    def _let_go(self) -> None:
        for descriptor in (self.file, self.folder):
            if descriptor >= 0:
                os.close(descriptor)
        self.file = self.folder = -1


def _status(path: str, folder: int | None = None) -> os.stat_result | None:
    try:
        return os.stat(path, dir_fd=folder)
    except FileNotFoundError:
        return None


@checked
def write_frames(
    path: str | os.PathLike[str],
    frames: Iterable[Frame],
    *,
    frame_rate: float = 30.0,
    like: RecordingStream | None = None,
    crf: float | None = None,
) -> None:
    """Write frames atomically, and losslessly except for JPEG; the suffix selects the kind of file.

    Args:
        path: ``.png`` (one frame), ``.jpg``/``.jpeg`` (one of 8 bits, quality 95), ``.tif``/``.tiff`` (one page per
            frame), ``.mkv`` (FFV1), ``.mp4`` or ``.mov`` (lossless H.264, 8 bits) or ``.npy`` (any type). The directory
            must exist.
        frames: any iterable of (rows, columns) or (rows, columns, 3), all of one shape and type, such as an array
            (frames, rows, columns); an array (rows, columns) is one frame, and .npy keeps this shape. uint8 or uint16;
            also float32 for TIFF and .npy, float64 for .npy.
        frame_rate: frames per second of a video, above 0.
        like: the open recording of which these are the processed frames, in order. Of a picture opacity, EXIF data and
            colour profile are kept, of a video its sound, its time stamps, its turn for display and what it states of
            range and colours. Colours can then be written as ``.mp4`` and ``.mov`` too, with the video's subsampling:
            HEVC where the video is HEVC, else H.264.
        crf: quality of H.264 and HEVC, 0 to 51, where ``like`` is a video; ``.mkv`` is then of this kind too. None: 10.

    Raises:
        FileError: a ValueError: an unknown suffix, no frame, or a type or shape that the kind of file cannot hold.
        OSError: the file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    single = isinstance(frames, np.ndarray) and frames.ndim == 2
    if single:
        frames = [np.asarray(frames)]
    with _written(path) as temporary, naming(path, str(temporary)):
        most = most_frames(path)
        if suffix in CODECS:
            write_video(temporary, frames, frame_rate, like, crf)
        else:
            every = _alike(frames, most)
            with naming(path, None):
                if suffix == ".npy":
                    with temporary.open("wb") as file:
                        # Through Python's file: tofile() says nothing of the last bytes that a disk does not take.
                        as_stream = types.SimpleNamespace(write=file.write)
                        np.save(as_stream, every[0] if single else np.stack(every), allow_pickle=False)
                else:
                    _write_picture(temporary, every, _PICTURES[suffix], None if like is None else like.picture)


def most_frames(path: str | os.PathLike[str]) -> float:
    """Number of frames that a kind of file holds; FileError: no such kind."""
    suffix, allowed = Path(path).suffix.lower(), (*_PICTURES, *CODECS, ".npy")
    if suffix not in allowed:
        raise FileError(f"{os.fspath(path)}: suffix: got {shown(suffix)}, allowed: {', '.join(allowed)}")
    return 1 if _PICTURES.get(suffix) in ("PNG", "JPEG") else math.inf


def _alike(frames: Iterable[Frame], most: float) -> list[Frame]:
    every: list[Frame] = []
    for frame in frames:
        if len(every) == most:  # before the others are made
            raise FileError("several frames, a PNG or JPEG picture holds one (use .tif, .mkv or .npy)")
        every.append(np.asarray(frame))
    if not every:
        raise FileError("frames: no frame to write")
    if any(frame.shape != every[0].shape or frame.dtype != every[0].dtype for frame in every):
        raise FileError("frames of different shapes or types")
    return every


def _write_picture(path: Path, frames: list[Frame], kind: str, like: PictureFormat | None) -> None:
    first = frames[0]
    types = (
        {"TIFF": (np.uint8, np.uint16, np.float32), "JPEG": (np.uint8,)} if first.ndim == 2 or kind == "JPEG" else {}
    )
    check_frame(first, types.get(kind, (np.uint8, np.uint16)))
    if like is not None:
        alphas = like.alphas[: len(frames)]
        frames = [_with_alpha(frame, alpha, kind) for frame, alpha in itertools.zip_longest(frames, alphas)]
    if first.dtype == np.uint16 and frames[0].ndim == 3:  # Pillow has no 16-bit colour
        if len(frames) > 1:
            raise FileError("several frames of 16-bit colour (use .mkv or .npy)")
        path.write_bytes(_deep_picture(frames[0], kind))
    else:
        images = [pillow().fromarray(np.ascontiguousarray(frame)) for frame in frames]
        images[0].save(path, kind, **_options(images, kind, like))
    if like is not None and kind == "PNG":
        whole = path.read_bytes()
        path.write_bytes(whole[:_PNG_HEADER] + like.chunks + whole[_PNG_HEADER:])


def _with_alpha(frame: Frame, alpha: Frame | None, kind: str) -> Frame:
    """The frame with its opacity as last colour, where there is one and the kind of file can hold it."""
    held = kind == "PNG" or (kind == "TIFF" and (frame.ndim == 3 or frame.dtype == np.uint8))
    return np.dstack((frame, alpha)) if held and alpha is not None and alpha.shape == frame.shape[:2] else frame


def _options(images: list[Any], kind: str, like: PictureFormat | None) -> dict[str, Any]:
    """Options of Pillow's ``save``."""
    options: dict[str, Any] = {"save_all": True, "append_images": images[1:]} if len(images) > 1 else {}
    if kind == "JPEG":
        options |= _JPEG
    if like is not None and not (kind == "PNG" and like.chunks):
        options |= like.options
        if kind == "TIFF" and like.orientation is not None:
            options |= {"exif": b"", "tiffinfo": {ORIENTATION: like.orientation}}
    return options


def _deep_picture(frame: Frame, kind: str) -> bytes:
    """A file of several colours of 16 bits."""
    av = pyav()
    pixels = {2: "ya16", 3: "rgb48", 4: "rgba64"}[frame.shape[2]] + ("be" if kind == "PNG" else "le")
    context = av.CodecContext.create(kind.lower(), "w")
    context.height, context.width = frame.shape[:2]
    context.pix_fmt, context.time_base = pixels, Fraction(1, 25)
    picture = av.VideoFrame(context.width, context.height, pixels)
    samples = frame.astype(">u2" if kind == "PNG" else "<u2").reshape(len(frame), -1).view(np.uint8)
    lines = np.zeros((len(frame), picture.planes[0].line_size), np.uint8)
    lines[:, : samples.shape[1]] = samples
    picture.planes[0].update(lines.tobytes())
    return b"".join(bytes(packet) for packet in [*context.encode(picture), *context.encode(None)])
