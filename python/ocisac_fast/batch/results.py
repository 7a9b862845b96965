"""Results as a folder of Parquet files, each written whole and renamed into place.

::

    results/task.json                 what is measured: command, options, version
    results/manifest.json             the same, and the length of each file that runs wrote
    results/rows/ab/PATH-STATE-….parquet   rows of a recording or of a stretch of it
    results/failures/PATH.parquet     recordings that could not be read
    results/cleaned/                  files written by ``clean``

PATH is a digest of a recording's path, STATE of its size and time of change: a name says what is finished, so that no
file has to be opened to know. A file counts if its length is the manifest's, and no other file is removed, but for
hidden ones of a killed run (``cleaned/.PATH.mkv``).
"""

from __future__ import annotations

import contextlib
import fcntl
import io
import json
import os
import re
import secrets
import tempfile
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from ocisac_fast.batch.fields import FAILURE, FIELDS, PATH, schema, table
from ocisac_fast.batch.listing import remote_like
from ocisac_fast.batch.measuring import build
from ocisac_fast.batch.recordings import Entry, digest
from ocisac_fast.batch.task import Task
from ocisac_fast.cli.output import plain
from ocisac_fast.cli.text import one_line
from ocisac_fast.core.checks import parsed_json
from ocisac_fast.files import FileError, FileWarning, Part, atomic_path
from ocisac_fast.files.extras import pyarrow
from ocisac_fast.files.remote import file_system, is_remote, is_url
from ocisac_fast.files.writing import TEMPORARY, fixed_outputs

_METADATA = b"ocisac"
_TASK, _MANIFEST, _FOLDERS = "task.json", "manifest.json", ("rows", "failures", "cleaned")
OWN = (_TASK, _MANIFEST, *_FOLDERS)
_OURS = re.compile(  # names of files that runs write
    r"task\.json|rows/([0-9a-f]{2})/\1[0-9a-f]{14}-[0-9a-f]{16}-(all|\d+-\d+-\d+)\.parquet"
    r"|failures/[0-9a-f]{16}\.parquet|cleaned/[0-9a-f]{16}-[^/]+"
)
_SAVING = 20.0  # the manifest is saved so seldom that it takes a twentieth of the time
_MOST_NAMED = 5
_NO_FILE = "other"  # type of pipes and devices, which could be waited for, for ever
_WHOLE = "all"
_MISSING = -1  # length
_FACTS: Any = {"path": str, "frames": int | None, "part": list | None, "warnings": list, "cleaned": dict | None}
_KEY = 16  # characters of a recording's key
_MAX_STEM = 200  # bytes, of the 255 that file systems allow


class ResultsError(ValueError):
    """A results folder that cannot be written or read, or that holds something else; one line."""


class Results:
    """The results folder of a task, of any file system of fsspec."""

    def __init__(self, folder: str | os.PathLike[str], locks: tuple[int, ...] = ()) -> None:
        self.folder = os.fspath(folder)  # as given
        self._system, self._root = file_system(self.folder)
        self.locks = locks  # descriptor of the folder, while a run writes here
        protocol = self._system.protocol  # one name, or several
        self.is_local = "file" in ((protocol,) if isinstance(protocol, str) else protocol)  # of this machine
        self._facts: dict[str, Any] = {}  # of the task, and lengths of files, both of the manifest
        self._lengths: dict[str, int] = {}
        self._next_save = 0.0
        self._held: dict[str, int] = {}  # of the manifest, that which this run wrote or found whole

    @contextlib.contextmanager
    def prepared(self, task: Task, again: bool, entries: Iterable[Entry]) -> Iterator[None]:
        """Make the folder for a task, or find that it is the task's; at the end manifest and files are whole.

        Raises:
            ResultsError: it holds results of other options or of another version, or what is not ours, or cannot be
                written, or files of this run were removed meanwhile.
        """
        facts = {**task.facts(), "version": build()["version"]}
        with self._alone():
            with self._errors():
                self._require_folders()
                there = None if again else self._task()
                if there is not None and there != facts:
                    raise ResultsError(
                        f"{self.folder}: made with {_difference(there, facts)}; allowed: the same, another "
                        "folder, or --again to measure all anew"
                    )
                manifest = self._read_json(_MANIFEST)
                self._lengths, self._facts = _lengths_in(manifest), facts
                if again:
                    self._discard({entry.key for entry in entries})
                elif there is None and _TASK not in self._lengths and self._length(_MANIFEST) != _MISSING:
                    raise ResultsError(f"{self.folder}: {_MANIFEST} is not of `ocisac batch`; allowed: another folder")
                if manifest.get("task") != facts:  # rows may be of other options
                    self._lengths = {name: size for name, size in self._lengths.items() if not name.startswith("rows/")}
                text = json.dumps(facts, indent=1).encode()
                self._lengths[_TASK] = len(text)
                self._save_manifest()  # before the file that it names: --again may remove this one
                self._write(_TASK, text)
            try:
                yield
            finally:
                with self._errors():
                    self._save_manifest()
            self._require_files()

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Refuse a second run in a local folder; the lock of a process ends with it, however it ends."""
        if not self.is_local:
            yield
            return
        with self._errors():
            os.makedirs(self._root, exist_ok=True)
            folder = os.open(self._root, os.O_RDONLY)
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(folder)
            raise ResultsError(f"{self.folder}: another run writes here; allowed: another folder, or its end") from None
        except OSError:
            pass  # a file system without locks
        self.locks = (folder,)
        try:
            yield
        finally:
            self.locks = ()
            os.close(folder)

    def _require_folder(self) -> None:
        """Refuse to make the folder again, and to write in another one that has its name now."""
        if not self.is_local:
            return
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            there = os.stat(self._root)
            if all(os.path.samestat(there, os.fstat(lock)) for lock in self.locks):
                return
        raise ResultsError(f"{self.folder}: moved or removed during the run; allowed: the same folder to its end")

    def _require_files(self) -> None:
        with self._errors():
            found = self._all_found()
            lost = [_TASK] if self._task() != self._facts else []
        if lost := lost + [name for name, length in self._held.items() if found.get(name) != length]:
            raise ResultsError(
                f"{self.folder}: {lost[0]}{_more(lost[1:])} removed or changed during the run; the same command "
                "measures what is missing"
            )

    def note(self, written: Mapping[str, int]) -> None:
        """Keep lengths of files that were written, by name below the folder."""
        self._require_folder()
        self._lengths.update(written)
        self._held.update(written)
        if time.monotonic() >= self._next_save:
            with self._errors():
                self._save_manifest()

    def _save_manifest(self) -> None:
        began = time.monotonic()
        self._write(_MANIFEST, json.dumps({"task": self._facts, "files": self._lengths}, indent=0).encode())
        self._next_save = time.monotonic() + _SAVING * (time.monotonic() - began)

    def _discard(self, keys: set[str]) -> None:
        """Remove the files of the manifest; what is left is named, and refused where the recordings of ``keys`` go."""
        there = [name for name in OWN if self._length(name) != _MISSING]
        stated = self._lengths.get(_TASK)
        if there and (stated is None or self._length(_TASK) not in (_MISSING, stated)):  # none: a run ended in between
            raise ResultsError(
                f"{self.folder}: holds {there[0]}, and no {_MANIFEST} of `ocisac batch` that says what --again may "
                "remove; allowed: another folder"
            )
        found = self._all_found()
        for name in found.keys() - self._lengths.keys():  # which a run that was killed could not name
            self._lengths.update(self._written_with(name)[1] if _OURS.fullmatch(name) else {})
        kept = [name for name, length in found.items() if self._lengths.get(name) != length]
        if taken := [name for name in kept if _OURS.fullmatch(name) and key_of(name) in keys]:
            raise ResultsError(
                f"{self.folder}: holds {taken[0]}{_more(taken[1:])}, which no run wrote, where this one writes; "
                "allowed: another folder"
            )
        for name in {*found, *([_TASK] if _TASK in there else [])} - {*kept}:
            self._system.rm_file(self._path(name))
        self._lengths.clear()
        self._system.invalidate_cache()
        if kept:
            named = f"{', '.join(kept[:_MOST_NAMED])}{_more(kept[_MOST_NAMED:])}"
            text = f"{self.folder}: kept, since no run wrote it: {named}"
            warnings.warn(text, FileWarning, stacklevel=4)

    def _length(self, name: str) -> int | None:
        """``_MISSING`` without such a file; None for a link, a pipe or a device."""
        with contextlib.suppress(FileNotFoundError):
            return _length_of(self._system.info(self._path(name)))
        return _MISSING

    def _all_found(self) -> dict[str, int | None]:
        """Lengths of all files but what killed runs left, which the next file of the same name removes."""
        self._system.invalidate_cache()
        every = [pair for folder in _FOLDERS for pair in self._found(folder).items()]
        return {name: length for name, length in every if not TEMPORARY.fullmatch(name)}

    def _found(self, folder: str) -> dict[str, int | None]:
        """Lengths of what is below a folder of the results, by name below the results; None of what is no file."""
        found, start = remote_like(self._system, self._path(folder)), len(self._path(""))
        for name, entry in found.items():
            if "failure" in entry:
                raise ResultsError(one_line(f"{self.folder}: {name[start:]}: {entry['failure']}"))
        return {name[start:]: _length_of(entry) for name, entry in sorted(found.items())}

    def contains(self, path: str) -> bool:
        """True for this folder, which may be in the campaign's, and for a path in it, through any links."""
        if self.is_local:
            return not is_url(path) and Path(os.path.realpath(path)).is_relative_to(os.path.realpath(self._root))
        return f"{path.rstrip('/')}/".startswith(f"{self.folder.rstrip('/')}/")

    def task_facts(self) -> dict[str, Any]:
        """The task's facts.

        Raises:
            ResultsError: no results folder.
        """
        with self._errors():
            facts = self._task()
        if facts is None:
            raise ResultsError(f"{self.folder}: no results of `ocisac batch`")
        return facts

    def checked_names(self, task: Task) -> dict[str, bool]:
        """Names of the files of rows; True for those as long as in the manifest, as is what was cleaned, or whole."""
        lost = self._lost_keys()
        checked = {}
        for name, length in self.names().items():
            held = None if self._lengths.get(name) == length else self.holds(name, task)
            if held is not None:
                self.note(held[1])
            checked[name] = self._lengths.get(name) == length and key_of(name) not in lost
            if checked[name]:
                self._held[name] = length
        return checked

    def remove_cleaned(self, keys: set[str]) -> None:
        """Remove what was cleaned of recordings in an earlier state; what is not as a run wrote it stays."""
        with self._errors():
            found = [name for name, length in self._found("cleaned").items() if self._lengths.get(name) == length]
        self.remove(name for name in found if key_of(name) in keys)

    def _lost_keys(self) -> set[str]:
        """Keys of recordings of which the cleaned file is not as it was written."""
        written = {name: length for name, length in self._lengths.items() if name.startswith("cleaned/")}
        found = self._found("cleaned") if written else {}
        return {key_of(name) for name, length in written.items() if found.get(name) != length}

    def names(self, kind: str = "rows") -> dict[str, int]:
        """Lengths of the files of rows or failures, by name."""
        with self._errors():
            self._system.invalidate_cache()
            found = {name: length for name, length in self._found(kind).items() if _OURS.fullmatch(name)}
            for name in (name for name, length in found.items() if length is None):
                self._require_file(name)
            for gone in [name for name in self._lengths if name.startswith(f"{kind}/") and name not in found]:
                del self._lengths[gone]  # measured again where it is of this run
            return {name: length for name, length in found.items() if length is not None}

    def holds(self, name: str, task: Task) -> tuple[dict[str, Any], dict[str, int]] | None:
        """Return facts and lengths of a whole file of rows of its recording, this task and version; else None."""
        facts, written = self._written_with(name)
        if (facts.get("task"), facts.get("build")) != (task.facts(), build()) or digest(facts["path"]) != key_of(name):
            return None
        return (facts, written) if all(self._length(each) == length for each, length in written.items()) else None

    def _written_with(self, name: str) -> tuple[dict[str, Any], dict[str, int]]:
        """The facts of a whole file of rows, and lengths of its files; empty of what no run wrote."""
        with contextlib.suppress(OSError, ValueError):
            self._require_file(name)
            with self._system.open(self._path(name), "rb") as file:
                facts = _facts(pyarrow("pyarrow.parquet").read_schema(file))
            if "task" in facts:
                return facts, {**(facts.get("cleaned") or {}), name: self._system.info(self._path(name))["size"]}
        return {}, {}

    def write_rows(self, name: str, rows: Any, facts: dict[str, Any]) -> dict[str, int]:
        """Write rows with their facts: the file's length by its name."""
        return {name: self._write_table(name, rows.replace_schema_metadata({_METADATA: json.dumps(facts)}))}

    def write_failure(self, entry: Entry, message: str) -> None:
        """Write why a recording could not be read."""
        name = f"failures/{entry.key}.parquet"
        self.note({name: self._write_table(name, table([failure_row(entry.path, message)], FAILURE))})

    def remove(self, names: Iterable[str]) -> None:
        """Remove files; those that are not there are no error."""
        with self._errors():
            for name in names:
                self._lengths.pop(name, None)
                self._held.pop(name, None)
                with contextlib.suppress(FileNotFoundError):
                    self._system.rm_file(self._path(name))

    @contextlib.contextmanager
    def cleaned(self, entry: Entry, suffix: str) -> Iterator[tuple[str, str, str]]:
        """A local path to write a cleaned recording to, its name below the folder, and the path where it will be.

        It gets this name at the end, after its rows: a run that is killed leaves nothing that no rows name.

        Raises:
            FileError: something has the name, which no run wrote as it is.
        """
        source = entry.path.partition("::")[0].partition("?")[0] if is_remote(entry.path) else entry.path
        stem = PurePosixPath(source).stem.encode(errors="surrogateescape")[-_MAX_STEM:].decode(errors="ignore")
        name = f"cleaned/{entry.key}-{stem}{suffix}"
        place = self._path(name)
        with self._errors():
            self._require_folder()
            self._system.makedirs(self._path("cleaned"), exist_ok=True)
            is_taken = self._system.lexists(place)
        if is_taken:
            raise FileError(f"{name} is not as a run wrote it, and stays; allowed: another place for it")
        with contextlib.ExitStack() as after:
            folder = self._path("cleaned") if self.is_local else after.enter_context(tempfile.TemporaryDirectory())
            temporary = f"{folder}/.{entry.key}{suffix}"
            Path(temporary).unlink(missing_ok=True)  # of a run that was killed
            after.callback(Path(temporary).unlink, missing_ok=True)
            try:
                yield temporary, name, place if self.is_local else self._system.unstrip_protocol(place)
            except OSError as error:
                if error.filename != temporary:
                    raise
                raise ResultsError(f"{self.folder}: {error.strerror}") from error
            if not os.path.exists(temporary):  # every frame stays as it is
                return
            if self.is_local:
                with fixed_outputs([place], replace=False), atomic_path(place) as new:
                    os.replace(temporary, new)
                return
            with self._errors():
                self._write(name, Path(temporary).read_bytes())

    def every_part(self) -> Iterator[tuple[dict[str, Any], Any]]:
        """Facts and rows of each file of rows of the folder's task, in the order of names."""
        task = {key: value for key, value in self.task_facts().items() if key != "version"}
        others: list[str] = []
        for name, is_stated in self._to_read("rows").items():
            facts, rows = self._read_table(name)
            if facts.get("task") == task:
                yield facts, rows
            elif is_stated:
                others.append(name)
        if others:
            named = f"{others[0]}{_more(others[1:])}"
            text = f"{self.folder}: {named} of other options, left out; the same command measures it"
            warnings.warn(text, FileWarning, stacklevel=2)

    def failures(self) -> Iterator[Any]:
        """The table of each file of failures."""
        for name in self._to_read("failures"):
            yield self._read_table(name)[1]

    def _to_read(self, kind: str) -> dict[str, bool]:
        """The files of rows or failures, True for those of the manifest; a warning names those that are not there."""
        with self._errors():
            self._require_folders()
            stated = _lengths_in(self._read_json(_MANIFEST))  # before the listing: a run may be going on
        found = self.names(kind)
        if lost := sorted(name for name in stated if name.startswith(f"{kind}/") and name not in found):
            text = f"{self.folder}: {lost[0]}{_more(lost[1:])} missing; the same command measures what is missing"
            warnings.warn(text, FileWarning, stacklevel=4)
        return {name: name in stated for name in found}

    def _read_table(self, name: str) -> tuple[dict[str, Any], Any]:
        """The facts and rows of a file."""
        with self._errors():
            data = self._system.cat_file(self._path(name))
        try:
            file = pyarrow().BufferReader(data)  # unlike BytesIO it is read without a thread, where none may start
            rows = pyarrow("pyarrow.parquet").ParquetFile(file).read(use_threads=False)
            return _facts(rows.schema), rows
        except (OSError, ValueError) as error:
            raise ResultsError(
                f"{self.folder}/{name}: no whole Parquet file; the same `ocisac batch` measures its recording again, "
                "once it is removed"
            ) from error

    def _write_table(self, name: str, rows: Any) -> int:
        buffer = io.BytesIO()
        pyarrow("pyarrow.parquet").write_table(rows, buffer)
        with self._errors():
            return self._write(name, buffer.getvalue())

    def _write(self, name: str, data: bytes) -> int:
        """Write a file, whole or not at all; its length."""
        path = self._path(name)
        self._require_file(name)
        self._require_folder()
        self._system.makedirs(self._system._parent(path), exist_ok=True)
        if self.is_local:
            with atomic_path(path) as temporary:
                temporary.write_bytes(data)
            return len(data)
        temporary_path = f"{self._system._parent(path)}/.{secrets.token_hex(8)}"
        self._system.pipe_file(temporary_path, data)
        self._system.mv(temporary_path, path)
        return len(data)

    def _task(self) -> dict[str, Any] | None:
        """The facts in task.json; None without it."""
        if self._length(_TASK) == _MISSING:
            return None
        facts = self._read_json(_TASK)
        if facts.get("command") not in [*FIELDS] or not isinstance(facts.get("options"), dict):
            raise ResultsError(f"{self.folder}: {_TASK} is not of `ocisac batch`; allowed: another folder")
        return facts

    def _read_json(self, name: str) -> dict[str, Any]:
        """The object of a file; empty where it is another program's or damaged."""
        self._require_file(name)
        try:
            found = parsed_json(self._system.cat_file(self._path(name)))
        except (FileNotFoundError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def _require_folders(self) -> None:
        """Refuse what is no folder where those of the results are."""
        rows = Path(self._path("rows")).glob("??") if self.is_local else ()
        for folder in (*_FOLDERS, *(f"rows/{each.name}" for each in rows)):
            self._require_file(folder)

    def _require_file(self, name: str) -> None:
        """Refuse what is no file, and links also among the folders of the results above it."""
        path = self._path(name)
        above = [self._path(str(each)) for each in (name, *PurePosixPath(name).parents[:-1])]
        with contextlib.suppress(FileNotFoundError):
            if (self.is_local and any(map(os.path.islink, above))) or self._system.info(path).get("type") == _NO_FILE:
                raise ResultsError(f"{self.folder}: {name} is a link, a pipe or a device; allowed: another folder")

    def _path(self, name: str) -> str:
        return f"{self._root.rstrip('/')}/{name}"

    @contextlib.contextmanager
    def _errors(self) -> Iterator[None]:
        """Convert errors of the file system to one line with the folder's name."""
        try:
            yield
        except ResultsError:
            raise
        except Exception as error:
            if self.is_local and not isinstance(error, (OSError, ValueError)):
                raise
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
    rows = _joined([empty, *results.failures()]).to_pylist()
    return table(sorted(rows, key=lambda row: row[PATH.name] or ""), FAILURE)


def _joined(tables: list[Any]) -> Any:
    return pyarrow().concat_tables([each.replace_schema_metadata(None) for each in tables]) if tables else None


def failure_row(path: str, message: str) -> dict[str, str]:
    """A row of the table of failures."""
    return {PATH.name: plain(path), "message": plain(message)}


def rows_name(entry: Entry, part: Part | None, frame_count: int | None) -> str:
    """Name of the file of rows of a recording (part None) or of a stretch of it."""
    stretch = _WHOLE if part is None else f"{part.first:09d}-{part.stop:09d}-{frame_count:09d}"
    return f"rows/{entry.key[:2]}/{entry.key}-{entry.state}-{stretch}.parquet"


def _more(names: list[str]) -> str:
    return f" and {len(names)} more" if names else ""


def is_of(name: str, entry: Entry) -> bool:
    """True if a file of rows is of the recording in its present state."""
    return f"/{entry.key}-{entry.state}-" in name


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
    """The key of the recording of a file."""
    return name.rpartition("/")[2][:_KEY]


def _length_of(entry: Mapping[str, Any]) -> int | None:
    return None if entry.get("islink") or entry.get("type") == _NO_FILE else entry.get("size")


def _lengths_in(manifest: Mapping[str, Any]) -> dict[str, int]:
    """Lengths of files by name below the folder; those of another program's file are none."""
    files = manifest.get("files")
    named = files.items() if isinstance(files, dict) else ()
    return {name: length for name, length in named if _OURS.fullmatch(name) and type(length) is int}


def _facts(rows: Any) -> dict[str, Any]:
    """The facts beside the rows in a schema's metadata; empty where another program wrote it.

    Raises:
        ValueError: facts of a task of other types.
    """
    found = parsed_json((rows.metadata or {}).get(_METADATA, b"{}"))
    if not isinstance(found, dict) or "task" not in found:
        return {}
    if not all(isinstance(found.get(name), kinds) for name, kinds in _FACTS.items()):
        raise ValueError("facts of other types")
    return found


def _difference(there: dict[str, Any], wanted: dict[str, Any]) -> str:
    """The first value in which two tasks differ: ``frequency 500.0 instead of 600.0``."""
    flat = [{**facts, **facts.get("options", {})} for facts in (there, wanted)]
    for name in sorted({*flat[0], *flat[1]} - {"options"}):
        old, new = (facts.get(name) for facts in flat)
        if old != new:
            return f"{name} {old} instead of {new}"
    return "other options"
