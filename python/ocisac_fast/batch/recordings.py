"""Recordings of a campaign: paths, folders and patterns of fsspec."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from ocisac_fast.files.remote import archive_state, file_system, is_remote, state_of

_MOST_FOLDERS = 10_000  # of a web server, whose links may lead on without an end


class EndlessError(ValueError):
    """A folder has more folders below it than may be listed."""


class Entry(NamedTuple):
    """A recording as a listing shows it; ``state`` changes with the recording, and is new where nothing states that."""

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
            Below a folder, and by ``**``, links to folders are not followed. A folder that cannot be read is an entry,
            which cannot be measured.

    Raises:
        ValueError: a pattern or a folder without a file; more than 10 000 folders below one of a web server.
    """
    every = (paths,) if isinstance(paths, (str, os.PathLike)) else paths
    found = {entry.path: entry for path in every for entry in _matching(os.fspath(path))}
    return [found[path] for path in sorted(found)]


def _matching(path: str) -> list[Entry]:
    found = list(_remote(path) if is_remote(path) else _local(path))
    if not found:
        raise ValueError(f"recordings: got {path}, allowed: a file, or a folder or pattern with files")
    return found


def _is_pattern(path: str) -> bool:
    return any(sign in path for sign in "*?[")


def _local(path: str) -> Iterator[Entry]:
    """Files of a path: one that exists is never a pattern, nor are the leading folders of a pattern that exist."""
    whole = os.path.abspath(path)
    names: Iterable[str] = [whole]
    if os.path.isdir(whole):
        names = _below(whole)
    elif _is_pattern(path) and not os.path.lexists(whole):
        names = _like(whole)
    yield from map(local_entry, names)


def local_entry(name: str) -> Entry:
    """A file of this machine as it is now."""
    status: dict[str, Any] = {"size": None}
    with contextlib.suppress(OSError):  # of one that is gone: measuring it names the failure
        there = os.stat(name)
        status = {"size": there.st_size, "mtime": there.st_mtime}
    return _entry(name, status)


def _below(folder: str) -> Iterator[str]:
    """Files below a folder, and folders there that cannot be read."""
    closed: list[str] = []
    for place, _, files in os.walk(folder, onerror=lambda error: closed.append(error.filename)):
        yield from (os.path.join(place, name) for name in files)
    yield from closed


def _like(pattern: str) -> Iterator[str]:
    """Files like a pattern, and folders in which there may be some, but that cannot be read."""
    root = next(folder for folder in Path(pattern).parents if os.path.isdir(folder))  # unlike is_dir(): no error
    parts = Path(pattern).relative_to(root).parts
    parts = (*parts, "*") if parts[-1] == "**" else parts
    folders = {root, *(each for k in range(1, len(parts)) for each in root.glob("/".join((*parts[:k], ""))))}
    yield from (str(folder) for folder in folders if os.path.isdir(folder) and not _can_be_listed(folder))
    yield from (str(name) for name in root.glob("/".join(parts)) if not os.path.isdir(name))


def _can_be_listed(folder: Path) -> bool:
    try:
        os.scandir(folder).close()
    except OSError:
        return False
    return True


def _remote(path: str) -> Iterator[Entry]:
    system, inner = file_system(path)
    entries: dict[str, Any] = {inner: {"size": None}}
    archive: str | None = None
    try:
        archive, entries = archive_state(path), _listed(system, inner)
    except EndlessError:
        raise
    except Exception:  # whatever a server answers: measuring the path names the failure
        pass
    # Listed names lack the host and the user of the path on some file systems, and the archive that they are in.
    place = next((each for each in (path.partition("::")[0], path) if each.endswith(inner)), None)
    for name, entry in entries.items():
        if entry.get("type") != "directory":
            if "name" in entry and state_of(entry) is None:  # of a listing of http
                with contextlib.suppress(Exception):
                    entry.update(system.info(name))
            whole = place and place.removesuffix(inner) + name + path[len(place) :]
            yield _entry(whole or str(system.unstrip_protocol(name)), entry, archive)


def _listed(system: Any, path: str) -> dict[str, Any]:
    entry = None
    with contextlib.suppress(FileNotFoundError):
        entry = system.info(path)
    if entry is None and not _is_pattern(path):
        return {path: {"size": None}}
    if entry and entry["type"] != "directory" and not path.endswith("/"):  # each page of http is a file
        return {path: entry}
    if entry and "http" in system.protocol:
        found = _files_below(system, path)
    else:
        found = system.find(path, detail=True) if entry else system.glob(path, detail=True)
    return {name: each for name, each in found.items() if "/?" not in name}  # links that sort


def _files_below(system: Any, path: str) -> dict[str, Any]:
    """Files in a web server's folder and those below it, the nearest first: ``find`` follows links without an end."""
    waiting = deque([path])
    found: dict[str, Any] = {}
    for _ in range(_MOST_FOLDERS):
        if not waiting:
            return found
        with contextlib.suppress(OSError):
            for entry in system.ls(waiting.popleft(), detail=True):
                if entry["type"] == "directory":
                    waiting.append(entry["name"])
                else:
                    found[entry["name"]] = entry
    raise EndlessError(f"recordings: got {path}, allowed: at most {_MOST_FOLDERS} folders below one of a web server")


def _entry(path: str, status: dict[str, Any], archive: str | None = "") -> Entry:
    return Entry(path, status.get("size"), digest(state_of(status, archive) or os.urandom(8).hex()))
