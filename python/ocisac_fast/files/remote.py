"""Recordings in buckets and on servers: paths of fsspec, such as ``s3://bucket/lamp.mkv``."""

from __future__ import annotations

import functools
import io
import re
from typing import Any, BinaryIO, cast

from ocisac_fast.files.extras import fsspec

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+(::|://)")
_WHOLE = 64 << 20  # bytes; smaller files are fetched by one request
_PIECE = 8 << 20


def is_remote(path: str) -> bool:
    """Return True for a path that names its file system: ``s3://…``, ``memory://…``, ``zip::…``."""
    return bool(_URL.match(path))


def modified(entry: dict[str, Any]) -> Any:
    """The time or mark of the last change in an entry of a file system's listing; None if it has none."""
    names = ("mtime", "LastModified", "last_modified", "modified", "modify", "ETag", "etag", "created")
    return next((entry[name] for name in names if entry.get(name) is not None), None)


class RemotePath:
    """What the readers use of ``pathlib.Path``, for a file of any file system."""

    def __init__(self, url: str) -> None:
        self._system, self._path = fsspec().core.url_to_fs(url)
        self._entry = self._system.info(self._path)
        if self._entry["type"] == "directory":
            raise IsADirectoryError(21, "Is a directory", url)

    def open(self, mode: str = "rb") -> BinaryIO:
        size = self._entry.get("size")
        if size is not None and size <= _WHOLE:
            return io.BytesIO(_fetched(self._system, self._path, size, str(modified(self._entry))))
        opened = self._system.open(self._path, mode, block_size=_PIECE, cache_type="readahead")
        return cast(BinaryIO, opened)

    def read_bytes(self) -> bytes:
        with self.open() as file:
            return file.read()


@functools.lru_cache(maxsize=1)  # a recording is read several times in a row: its kind, its hash, its frames
def _fetched(system: Any, path: str, size: int, changed: str) -> bytes:
    return bytes(system.cat_file(path))
