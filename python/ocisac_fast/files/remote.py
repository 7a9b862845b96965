"""Recordings in buckets and on servers: paths of fsspec, such as ``s3://bucket/lamp.mkv``."""

from __future__ import annotations

import contextlib
import errno
import functools
import io
import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from ocisac_fast.files.extras import fsspec
from ocisac_fast.files.recording import FileError

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+(::|://)")
_OF_THIS_MACHINE = re.compile(r"(.*::)?(file|local)://|(?!(zip|tar|libarchive)\b).*::(?!.*://)")
_WHOLE = 64 << 20  # bytes; smaller files are fetched by one request
_PIECE = 8 << 20
_SILENCE = 30.0  # s, longest of a server


def is_url(path: str) -> bool:
    """True for a path like a URL that is no local file."""
    return bool(_URL.match(path)) and not os.path.lexists(path)


def is_remote(path: str) -> bool:
    """Return True for a path that names its file system: ``s3://…``, ``memory://…``, ``zip::…``, and no local file.

    Raises:
        FileError: ``file://`` or ``simplecache::/…``: what is read, and what is not to be overwritten, has one name.
    """
    if not is_url(path):
        return False
    if _OF_THIS_MACHINE.match(path):
        raise FileError(f"path: got {path}, allowed: the path alone of a file of this machine")
    return True


def local_part(path: str) -> str:
    """The file of this machine that a path is of, such as an archive; the path itself where there is none."""
    _, wrapped, last = path.rpartition("::")
    return last if wrapped and "://" not in last else path


def absolute(path: str) -> str:
    """The absolute path of a file of this machine; ``..`` is above the folder that a link before it leads to.

    Raises:
        FileError: no name, which would be the working folder's.
        OSError: what is before a ``..`` is no folder.
    """
    if not path:
        raise FileError("path: got no name, allowed: that of a file or a folder")
    parts = Path(path if os.path.isabs(path) else os.path.join(os.getcwd(), path)).parts
    last = max((number for number, part in enumerate(parts, 1) if part == ".."), default=0)
    if not last:
        return os.path.abspath(path)
    above = os.path.join(*parts[:last])
    os.stat(above)  # realpath() takes a missing folder's name away with its ".."
    return os.path.join(os.path.realpath(above), *parts[last:])


def file_system(path: str) -> tuple[Any, str]:
    """The file system of a path, and the path there."""
    if not is_remote(path):
        return fsspec().filesystem("file"), absolute(path)
    place = local_part(path)
    if place != path and os.path.exists(place) and not os.path.isfile(place):  # a device may have no end
        raise FileError(f"path: got {path}, allowed: an archive that is a file")
    with _one_line_errors(path):
        chain = {part.partition("://")[0] for part in path.split("::")}  # a member's name may be like an address
        options = {name: {"client_kwargs": _bounded()} for name in chain & {"http", "https"}}
        system, inner = fsspec().core.url_to_fs(path, **options)
        system.invalidate_cache()  # of listings: others change what is there
        return system, inner


@functools.cache
def _bounded() -> dict[str, Any]:
    """Options of clients of HTTP, whose servers may send nothing, or more than was asked for, without an end."""
    import aiohttp

    class Response(aiohttp.ClientResponse):  # type: ignore[misc]
        async def read(self) -> bytes:
            data = bytearray()
            async for piece in self.content.iter_chunked(_PIECE):
                data += piece
                if len(data) > _WHOLE:
                    self.close()
                    raise OSError(errno.EFBIG, f"an answer of more than {_WHOLE >> 20} MiB", str(self.url))
            return bytes(data)

        async def text(self, encoding: str | None = None, errors: str = "strict") -> str:
            return (await self.read()).decode(encoding or self.charset or "utf-8", errors)

    timeout = aiohttp.ClientTimeout(total=None, sock_connect=_SILENCE, sock_read=_SILENCE)
    return {"response_class": Response, "timeout": timeout}


@contextlib.contextmanager
def _one_line_errors(url: str) -> Iterator[None]:
    """Whatever a file system and its libraries raise, as an error that input provokes."""
    try:
        yield
    except (ImportError, ValueError) as error:  # a library that is not installed, a protocol that is not known
        raise FileError(f"{url}: {error}") from error
    except FileNotFoundError as error:
        reason = f" ({error.__cause__})" if error.__cause__ else ""
        raise FileNotFoundError(errno.ENOENT, f"{os.strerror(errno.ENOENT)}{reason}", url) from error
    except TimeoutError as error:
        raise OSError(errno.ETIMEDOUT, f"no answer in {_SILENCE:g} s", url) from error
    except OSError:
        raise
    except Exception as error:
        is_no_file = url.startswith("tar:") and isinstance(error, (AttributeError, KeyError, RecursionError))
        reason = "no file, nor a link to one" if is_no_file else f"{type(error).__name__}: {error}"
        raise OSError(errno.EIO, reason, url) from error


_MARKS = "etag lastmodified mtime modified modify modificationtime modifiedat updated crc sha blobid contentmd5 created"


def state_of(entry: dict[str, Any], archive: str | None = "") -> str | None:
    """Text that changes with a file of a listing, or with the archive that it is in; None where no mark is stated."""
    marks = {re.sub("[^a-z0-9]", "", name.lower()): value for name, value in entry.items() if value is not None}
    mark = next((marks[name] for name in _MARKS.split() if name in marks), None)
    return None if mark is None or archive is None else f"{entry.get('size')} {mark} {archive}"


def archive_state(path: str) -> str | None:
    """State of the file that a path is in, an archive whose listing may have no times; empty where it is in none."""
    with contextlib.suppress(IsADirectoryError):
        archive = path.partition("::")[2]
        return RemotePath(archive).state if archive else ""
    return ""


@functools.lru_cache(maxsize=1)
def _members(system: Any) -> Counter[str]:
    """How often an archive's members have each name; of equal ones a listing has the last alone."""
    if hasattr(system, "tar"):
        return Counter(re.sub("/+", "/", name) for name in system.tar.getnames())
    return Counter(system.zip.namelist() if hasattr(system, "zip") else ())


class RemotePath:
    """What the readers use of ``pathlib.Path``, for a file of any file system."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._system, self._path = file_system(url)
        with _one_line_errors(url):
            self._entry = self._system.info(self._path)
        if self._entry["type"] == "directory":
            raise IsADirectoryError(21, "Is a directory", url)
        if (count := _members(self._system)[self._entry["name"]]) > 1:
            raise FileError(f"{url}: {count} members of its archive have this name, allowed: one")
        self.state = state_of(self._entry, archive_state(url))

    def open(self, mode: str = "rb") -> BinaryIO:
        size = self._entry.get("size")
        with _one_line_errors(self.url):
            if size is not None and size <= _WHOLE:
                return io.BytesIO(_fetched(self._system, self._path, self.state or os.urandom(8)))
            opened = self._system.open(self._path, mode, block_size=_PIECE, cache_type="readahead")
            if size is not None:
                _require_ranges(opened, size, self.url)
                return io.BufferedReader(_Ranges(opened, self))
            data = bytearray()
            with opened:  # without a stated size there are no ranges, and a piece is what has arrived
                while len(data) <= _WHOLE and (piece := opened.read(_PIECE)):
                    data += piece
        if len(data) > _WHOLE:
            raise FileError(f"{self.url}: no stated size, and more than {_WHOLE >> 20} MiB")
        return io.BytesIO(data)


def _require_ranges(file: Any, size: int, url: str) -> None:
    try:
        file.seek(size - 1)
        file.read(1)
        file.seek(0)
    except ValueError as error:
        most = f"{_WHOLE >> 20} MiB"
        raise FileError(f"{url}: more than {most}, and its server gives no parts, allowed: a copy of it") from error


class _Ranges(io.RawIOBase):
    """A file that is read by ranges."""

    def __init__(self, file: Any, place: RemotePath) -> None:
        self._file, self._place = file, place  # whose file system closes an archive once nothing needs it

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        with _one_line_errors(self._place.url):
            data = self._file.read(min(len(buffer), _PIECE))
        buffer[: len(data)] = data
        return len(data)

    def seek(self, offset: int, whence: int = 0) -> int:
        return int(self._file.seek(offset, whence))

    def tell(self) -> int:
        return int(self._file.tell())

    def close(self) -> None:
        self._file.close()
        super().close()


@functools.lru_cache(maxsize=1)  # a recording is read several times in a row: its kind, its hash, its frames
def _fetched(system: Any, path: str, state: object) -> bytes:
    return bytes(system.cat_file(path))
