"""Recordings of a campaign: paths, folders and patterns of fsspec."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ocisac_fast.batch.listing import ALL_BELOW, EndlessError, Found, is_pattern, like, local_listing, remote_like
from ocisac_fast.files.extras import fsspec
from ocisac_fast.files.recording import FileError
from ocisac_fast.files.remote import RemotePath, absolute, archive_state, file_system, is_remote, state_of
from ocisac_fast.files.writing import TEMPORARY

_OF_RESULTS = re.compile(r"(.*)/(?:(?:task|manifest)\.json|summary\.png|(?:rows|failures|cleaned)/.*)", re.DOTALL)
_MANIFEST = re.compile(rb'\{\s*"task":\s*\{\s*"command":')
_LONG, _END = 1 << 30, 64 << 20  # bytes
_MOST_FOLDERS = 10_000  # of a web server, whose links may lead on without an end


class Entry(NamedTuple):
    """A recording as a listing shows it; ``state`` changes with the recording, and is new where nothing states that.

    ``failure``: why it cannot be measured, as the listing knows.
    """

    path: str
    size: int | None
    state: str
    failure: str = ""

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
            which cannot be measured. Temporary files of this package are left out, and results of other campaigns,
            unless the pattern or the folder names their folder or ``cleaned``.

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


def _local(path: str) -> Iterator[Entry]:
    """Files of a path: one that exists is never a pattern, nor are the leading folders of a pattern that exist."""
    whole = absolute(path)
    found: Found = {whole: {}}
    if os.path.isfile(whole):
        os.stat(path)  # refuses "file/"
    elif os.path.isdir(whole):
        found = _without_own(like(local_listing, whole, ALL_BELOW), whole)
    elif is_pattern(path) and not os.path.lexists(whole):
        root = next(folder for folder in Path(whole).parents if os.path.isdir(folder))  # unlike is_dir(): no error
        parts = Path(whole).relative_to(root).parts
        found = _without_own(like(local_listing, str(root), parts), str(root), parts)
    for name, entry in found.items():
        yield _entry(name, entry) if "failure" in entry else local_entry(name)


def _without_own(found: Found, root: str, parts: Sequence[str] = (), system: Any = None) -> Found:
    """A listing like ``parts`` below ``root`` without this package's temporary files and results of campaigns."""

    @functools.cache
    def has_results(folder: str) -> bool:
        files, name = system or fsspec().filesystem("file"), f"{folder}/manifest.json"
        with contextlib.suppress(Exception):  # whatever a server answers
            return files.info(name)["type"] == "file" and bool(_MANIFEST.match(files.cat_file(name, 0, 64)))
        return False

    def is_own(name: str) -> bool:
        result = None if "cleaned" in parts else _OF_RESULTS.fullmatch(name)
        is_result = result is not None and len(result[1]) > len(root) and has_results(result[1])
        return is_result or TEMPORARY.fullmatch(name) is not None

    return {name: entry for name, entry in found.items() if not is_own(name)}


def local_entry(name: str) -> Entry:
    """A file of this machine as it is now."""
    status: dict[str, Any] = {"size": None}
    with contextlib.suppress(OSError):  # of one that is gone: measuring it names the failure
        there = os.stat(name)
        status = {"size": there.st_size, "mtime": there.st_mtime}
    return _entry(name, status)


def require_file(path: str) -> None:
    """Refuse what opening could wait for, for ever.

    Raises:
        FileError: a pipe, a device or a folder.
    """
    if not is_remote(path) and os.path.exists(path) and not os.path.isfile(path):
        raise FileError(f"{path}: a pipe, device or folder, allowed: a file")


def present_state(path: str) -> str | None:
    """State of one file as it is now; None where nothing states it."""
    return RemotePath(path).state if is_remote(path) else local_entry(path).state


def content_hash(path: str) -> dict[str, str]:
    """SHA-256 of a file's bytes, hexadecimal; of a long one, which may be a hole, of its first and last 64 MiB."""
    with RemotePath(path).open() if is_remote(path) else open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        if size <= _LONG:
            return {"sha256": hashlib.file_digest(file, "sha256").hexdigest()}  # type: ignore[arg-type]
        found = hashlib.sha256(file.read(_END))
        file.seek(-_END, os.SEEK_END)
        found.update(file.read(_END))
        return {"sha256_of_ends": found.hexdigest()}


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
            whole = whole or str(system.unstrip_protocol(name))
            if whole.count("::") > path.count("::") or system._strip_protocol(name) != name:
                # Whoever made an archive would choose what is opened.
                entry = {"failure": "a name that would be read as another path, allowed: a copy of it outside"}
            yield _entry(whole, entry, archive)


def _listed(system: Any, path: str) -> dict[str, Any]:
    entry = None
    with contextlib.suppress(FileNotFoundError):
        entry = system.info(path)
    if entry is None and not is_pattern(path):
        return {path: {"size": None}}
    if entry and entry["type"] != "directory" and not path.endswith("/"):  # each page of http is a file
        return {path: entry}
    most = _MOST_FOLDERS if "http" in system.protocol else None
    root = path if entry else re.split(r"[^/]*[*?[]", path, maxsplit=1)[0]
    found = remote_like(system, root, pattern := path[len(root) :], most)
    found = _without_own(found, root, pattern.split("/"), system)
    return {name: each for name, each in found.items() if "/?" not in name}  # links that sort


def _entry(path: str, status: dict[str, Any], archive: str | None = "") -> Entry:
    state = digest(state_of(status, archive) or os.urandom(8).hex())
    return Entry(path, status.get("size"), state, status.get("failure", ""))
