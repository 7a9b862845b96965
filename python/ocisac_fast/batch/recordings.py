"""Recordings of a campaign: paths, folders and patterns of fsspec."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from ocisac_fast.files.extras import fsspec
from ocisac_fast.files.remote import is_remote, modified


class Entry(NamedTuple):
    """A recording as a listing shows it; ``state`` changes with its size and its time of change."""

    path: str
    size: int | None
    state: str

    @property
    def key(self) -> str:
        """Name of the path in names of files."""
        return digest(self.path)


def digest(text: str) -> str:
    """16 hexadecimal digits."""
    return hashlib.blake2b(text.encode(errors="surrogateescape"), digest_size=8).hexdigest()


def find_recordings(paths: str | os.PathLike[str] | Iterable[str | os.PathLike[str]]) -> list[Entry]:
    """Find recordings, in the order of their paths, each once.

    Args:
        paths: files, folders (all files below) and patterns (``campaign/**/*.mkv``), also of fsspec's file systems.

    Raises:
        ValueError: a pattern or a folder without a file.
    """
    every = (paths,) if isinstance(paths, (str, os.PathLike)) else paths
    found = {entry.path: entry for path in every for entry in _matching(os.fspath(path))}
    return [found[path] for path in sorted(found)]


def _matching(path: str) -> Iterator[Entry]:
    system, inner = fsspec().core.url_to_fs(path)
    entries: dict[str, Any] = {}
    if any(sign in path for sign in "*?["):
        entries = system.glob(inner, detail=True)
    if not entries and system.isdir(inner):
        entries = system.find(inner, detail=True)
    elif not entries and (not any(sign in path for sign in "*?[") or system.exists(inner)):
        entries = {inner: _info(system, inner)}
    files = {name: entry for name, entry in entries.items() if entry.get("type") != "directory"}
    if not files:
        raise ValueError(f"recordings: got {path}, allowed: a file, or a folder or pattern with files")
    for name, entry in files.items():
        full = _url(system, path, inner, name) if is_remote(path) else name
        yield Entry(full, entry.get("size"), digest(f"{entry.get('size')} {modified(entry)}"))


def _url(system: Any, pattern: str, inner: str, name: str) -> str:
    """The URL of a listed file: with the host and user of the pattern, which a name lacks on some file systems."""
    is_prefixed = pattern.endswith(inner)
    return pattern.removesuffix(inner) + name if is_prefixed else str(system.unstrip_protocol(name))


def _info(system: Any, path: str) -> dict[str, Any]:
    """The entry of a file; one that is not there gets an entry, so that measuring it names the failure."""
    try:
        entry: dict[str, Any] = system.info(path)
        return entry
    except OSError:
        return {"type": "file", "size": None}
