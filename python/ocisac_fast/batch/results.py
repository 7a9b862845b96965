"""Results as a folder of Parquet files, each written whole and renamed into place.

::

    results/task.json                 what is measured: command, options, version
    results/rows/ab/PATH-STATE-….parquet   rows of a recording or of a stretch of it
    results/failures/PATH.parquet     recordings that could not be read
    results/cleaned/                  files written by ``clean``

PATH is a digest of a recording's path, STATE of its size and time of change: a name says what is finished, so that no
file has to be opened to know.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import secrets
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any

from ocisac_fast.batch.fields import FAILURE, PATH, schema, table
from ocisac_fast.batch.measuring import build
from ocisac_fast.batch.recordings import Entry
from ocisac_fast.batch.task import Task
from ocisac_fast.cli.output import plain
from ocisac_fast.cli.text import one_line
from ocisac_fast.files import Part, atomic_path
from ocisac_fast.files.extras import fsspec, pyarrow

_METADATA = b"ocisac"
_WHOLE = "all"
_MAX_STEM = 200  # bytes, of the 255 that file systems allow
_PICTURES = {".png": ".png", ".jpg": ".png", ".jpeg": ".png", ".tif": ".tif", ".tiff": ".tif", ".npy": ".npy"}


class ResultsError(ValueError):
    """A results folder that cannot be written or read, or that holds something else; one line."""


class Results:
    """The results folder of a task, of any file system of fsspec.

    Attributes:
        folder: as given.
        is_local: True if it is a folder of this machine.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = os.fspath(folder)
        self._system, self._root = fsspec().core.url_to_fs(self.folder)
        self.is_local = "file" in _protocols(self._system)

    def prepare(self, task: Task, again: bool) -> None:
        """Make the folder for a task, or find that it is the task's.

        Raises:
            ResultsError: it holds results of other options or of another version, or cannot be written.
        """
        facts = {**task.facts(), "version": build()["version"]}
        with self._errors():
            there = self._read_json("task.json")
            if again and there is not None:
                for name in ("rows", "failures", "cleaned"):
                    if self._system.exists(self._path(name)):
                        self._system.rm(self._path(name), recursive=True)
            elif there is not None and there != facts:
                raise ResultsError(
                    f"{self.folder}: made with {_difference(there, facts)}; allowed: the same, another "
                    "folder, or --again to measure all anew"
                )
            self._write("task.json", json.dumps(facts, indent=1).encode())

    def contains(self, path: str) -> bool:
        """True for a path in this folder, which may be in the campaign's."""
        root = self._root if self.is_local else self.folder
        return path.startswith(root.rstrip("/") + "/")

    def task_facts(self) -> dict[str, Any]:
        """The task's facts.

        Raises:
            ResultsError: no results folder.
        """
        with self._errors():
            facts = self._read_json("task.json")
        if facts is None:
            raise ResultsError(f"{self.folder}: no results of `ocisac batch`")
        return facts

    def names(self, kind: str = "rows") -> list[str]:
        """Names of the files of rows or failures."""
        with self._errors():
            self._system.invalidate_cache()
            if not self._system.exists(self._path(kind)):
                return []
            return sorted(PurePosixPath(name).name for name in self._system.find(self._path(kind)) if _is_whole(name))

    def holds(self, name: str) -> dict[str, Any] | None:
        """The facts of a file of rows; None if it is not there."""
        with self._errors():
            if not self._system.exists(self._path(_place(name))):
                return None
            return self._facts(name)

    def write_rows(self, name: str, rows: Any, facts: dict[str, Any]) -> None:
        """Write rows with their facts."""
        marked = rows.replace_schema_metadata({_METADATA: json.dumps(facts)})
        self._write_table(_place(name), marked)

    def write_failure(self, entry: Entry, message: str) -> None:
        """Write why a recording could not be read."""
        self._write_table(f"failures/{entry.key}.parquet", table([failure_row(entry.path, message)], FAILURE))

    def remove(self, names: Iterable[str], kind: str = "rows") -> None:
        """Remove files; those that are not there are no error."""
        with self._errors():
            for name in names:
                path = self._path(_place(name) if kind == "rows" else f"{kind}/{name}")
                with contextlib.suppress(FileNotFoundError):
                    self._system.rm_file(path)

    @contextlib.contextmanager
    def cleaned(self, entry: Entry) -> Iterator[tuple[str, str]]:
        """A local path to write a cleaned recording to, and the path where it will be."""
        source = PurePosixPath(entry.path)
        stem = source.stem.encode(errors="surrogateescape")[-_MAX_STEM:].decode(errors="ignore")
        name = f"cleaned/{entry.key}-{stem}{_PICTURES.get(source.suffix.lower(), '.mkv')}"
        with self._errors():
            self._system.makedirs(self._path("cleaned"), exist_ok=True)
        if self.is_local:
            yield self._path(name), self._path(name)
            return
        with tempfile.TemporaryDirectory() as folder:
            local = str(Path(folder) / PurePosixPath(name).name)
            yield local, self._system.unstrip_protocol(self._path(name))
            with self._errors():
                self._write(name, Path(local).read_bytes())

    def every_part(self) -> Iterator[tuple[dict[str, Any], Any]]:
        """Facts and rows of each file of rows, in the order of names."""
        for name in self.names():
            rows = self._read_table(_place(name))
            yield json.loads(rows.schema.metadata[_METADATA]), rows

    def failures(self) -> Iterator[Any]:
        """The table of each file of failures."""
        for name in self.names("failures"):
            yield self._read_table(f"failures/{name}")

    def _facts(self, name: str) -> dict[str, Any]:
        with self._system.open(self._path(_place(name)), "rb") as file:
            metadata = pyarrow("pyarrow.parquet").read_schema(file).metadata
        facts: dict[str, Any] = json.loads(metadata[_METADATA])
        return facts

    def _read_table(self, name: str) -> Any:
        with self._errors(), self._system.open(self._path(name), "rb") as file:
            return pyarrow("pyarrow.parquet").read_table(io.BytesIO(file.read()))

    def _write_table(self, name: str, rows: Any) -> None:
        buffer = io.BytesIO()
        pyarrow("pyarrow.parquet").write_table(rows, buffer)
        with self._errors():
            self._write(name, buffer.getvalue())

    def _write(self, name: str, data: bytes) -> None:
        path = self._path(name)
        self._system.makedirs(self._system._parent(path), exist_ok=True)
        if self.is_local:
            with atomic_path(path) as temporary:
                temporary.write_bytes(data)
            return
        temporary_path = f"{self._system._parent(path)}/.{secrets.token_hex(8)}"
        self._system.pipe_file(temporary_path, data)
        self._system.mv(temporary_path, path)

    def _read_json(self, name: str) -> dict[str, Any] | None:
        if not self._system.exists(self._path(name)):
            return None
        facts: dict[str, Any] = json.loads(self._system.cat_file(self._path(name)))
        return facts

    def _path(self, name: str) -> str:
        return f"{self._root.rstrip('/')}/{name}"

    @contextlib.contextmanager
    def _errors(self) -> Iterator[None]:
        """Convert errors of the file system to one line with the folder's name."""
        try:
            yield
        except ResultsError:
            raise
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else None
            raise ResultsError(f"{self.folder}: {one_line(str(reason or error))}") from error


def read_results(folder: str | os.PathLike[str]) -> Any:
    """All rows of a results folder, in the order of paths and frames.

    Returns:
        ``pyarrow.Table``, None without a row; ``pyarrow.dataset.dataset(folder + "/rows")`` reads it in pieces.

    Raises:
        ResultsError: no results folder.
    """
    results = Results(folder)
    results.task_facts()
    parts = sorted(results.every_part(), key=lambda part: (part[0]["path"], part[0]["part"] or [0]))
    return _joined([rows for _, rows in parts])


def read_failures(folder: str | os.PathLike[str]) -> Any:
    """The recordings that could not be read, in the order of paths: ``pyarrow.Table`` of path and message."""
    results = Results(folder)
    results.task_facts()
    empty = schema(FAILURE).empty_table()
    return _joined([empty, *results.failures()]).sort_by(PATH.name)


def _joined(tables: list[Any]) -> Any:
    return pyarrow().concat_tables([each.replace_schema_metadata(None) for each in tables]) if tables else None


def failure_row(path: str, message: str) -> dict[str, str]:
    """A row of the table of failures."""
    return {PATH.name: plain(path), "message": plain(message)}


def rows_name(entry: Entry, part: Part | None, frame_count: int | None) -> str:
    """Name of the file of rows of a recording (part None) or of a stretch of it."""
    stretch = _WHOLE if part is None else f"{part.first:09d}-{part.stop:09d}-{frame_count:09d}"
    return f"{entry.key}-{entry.state}-{stretch}.parquet"


def is_of(name: str, entry: Entry) -> bool:
    """True if a file of rows is of the recording in its present state."""
    return name.startswith(f"{entry.key}-{entry.state}-")


def are_whole(names: Iterable[str]) -> bool:
    """True if files of rows cover all frames of their recording."""
    position, count = 0, 1
    for name in sorted(names):
        words = name.removesuffix(".parquet").split("-")[2:]
        if words == [_WHOLE]:
            return True
        first, stop, count = map(int, words)
        if first != position:
            return False
        position = stop
    return position == count


def key_of(name: str) -> str:
    """The key of the recording of a file of rows or failures."""
    return name.partition("-")[0].removesuffix(".parquet")


def _place(name: str) -> str:
    return f"rows/{name[:2]}/{name}"


def _is_whole(name: str) -> bool:
    base = PurePosixPath(name).name
    return base.endswith(".parquet") and not base.startswith(".")


def _protocols(system: Any) -> tuple[str, ...]:
    return (system.protocol,) if isinstance(system.protocol, str) else tuple(system.protocol)


def _difference(there: dict[str, Any], wanted: dict[str, Any]) -> str:
    """The first value in which two tasks differ: ``frequency 500.0 instead of 600.0``."""
    flat = [{**facts, **facts.get("options", {})} for facts in (there, wanted)]
    for name in sorted({*flat[0], *flat[1]} - {"options"}):
        old, new = (facts.get(name) for facts in flat)
        if old != new:
            return f"{name} {old} instead of {new}"
    return "other options"
