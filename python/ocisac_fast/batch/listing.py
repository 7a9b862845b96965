"""Lists the files below folders of any file system, without recursion; states each folder that cannot be listed."""

from __future__ import annotations

import contextlib
import fnmatch
import os
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any

Found = dict[str, dict[str, Any]]
ALL_BELOW = ("**", "*")


class EndlessError(ValueError):
    """A folder has more folders below it than may be listed."""


def is_pattern(text: str) -> bool:
    """True with a sign of patterns."""
    return any(sign in text for sign in "*?[")


def like(
    listing: Callable[[str, str], Iterable[dict[str, Any]]], root: str, parts: Sequence[str], most: int | None = None
) -> Found:
    """Files like the parts of a pattern below a folder, by name; a folder that cannot be listed states its ``failure``.

    Args:
        listing: entries of a folder, at least those like a part; by ``**``, those with ``islink`` are not followed.
        most: folders that are listed.

    Raises:
        EndlessError: more folders than ``most``.
    """
    closed: Found = {}
    known: dict[tuple[str, str], list[dict[str, Any]]] = {}

    def listed(folder: str, part: str) -> list[dict[str, Any]]:
        if (folder, part) not in known:
            if len(known) == most:
                raise EndlessError(f"recordings: got {root}, allowed: at most {most} folders below one of a web server")
            known[folder, part] = []
            try:
                known[folder, part] = list(listing(folder, part))
            except (FileNotFoundError, NotADirectoryError):  # gone meanwhile
                pass
            except Exception as error:  # whatever a server answers
                closed[folder] = {"name": folder, "failure": str(getattr(error, "strerror", None) or error)}
        return known[folder, part]

    found: Found = {root: {"type": "directory"}}
    for part in (*parts, "*") if parts[-1] == "**" else parts:
        folders = [name for name, entry in found.items() if _is_folder(entry)]
        if part == "**":
            reached = dict.fromkeys(folders)
            for folder in folders:  # which grow
                inner = (each for each in listed(folder, "*") if _is_folder(each) and not each.get("islink"))
                new = dict.fromkeys(each["name"] for each in inner if each["name"] not in reached)
                reached |= new
                folders += new
            found = {name: {"type": "directory"} for name in folders}
        else:
            is_like, wanted = re.compile(fnmatch.translate(part)).match, "*" if is_pattern(part) else part
            every = [each for folder in folders for each in listed(folder, wanted)]
            found = {each["name"]: each for each in every if is_like(each["name"].rstrip("/").rpartition("/")[2])}
    return {name: entry for name, entry in found.items() if not _is_folder(entry)} | closed


def _is_folder(entry: dict[str, Any]) -> bool:
    return entry.get("type") == "directory"


def local_listing(folder: str, part: str) -> Iterable[dict[str, Any]]:
    """Entries of a folder of this machine; of a part that is no pattern its own alone, without reading the folder."""
    if is_pattern(part):
        with os.scandir(folder) as entries:
            return [_local_entry(each.path, each.is_dir) for each in entries]
    name = os.path.join(folder, part)
    os.lstat(name)
    return [_local_entry(name, lambda: os.path.isdir(name))]


def _local_entry(name: str, is_dir: Callable[[], bool]) -> dict[str, Any]:
    is_folder = False
    with contextlib.suppress(OSError):  # of a link to what cannot be looked at
        is_folder = is_dir()
    return {"name": name, "type": "directory" if is_folder else "file", "islink": is_folder and os.path.islink(name)}


def remote_like(system: Any, root: str, pattern: str = "", most: int | None = None) -> Found:
    """Files below a folder of fsspec, or what continues it like a pattern, as ``like`` gives them."""
    kind = type(system)
    if not {kind.find.__module__, getattr(kind, "_find", kind.find).__module__} <= {"fsspec.spec", "fsspec.asyn"}:
        # One with its own, as buckets have; the usual one recurses and leaves out folders.
        return dict(system.glob(root + pattern, detail=True) if pattern else system.find(root, detail=True))
    parts = pattern.split("/") if pattern else ALL_BELOW
    return like(lambda place, _: system.ls(place, detail=True), root, parts, most)
