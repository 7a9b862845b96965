"""Many recordings: what is to do, what is finished, what failed."""

from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, field
from typing import Any

from ocisac_fast.batch.engines import in_this_process, on_cluster, thread_count
from ocisac_fast.batch.fields import FAILURE, columns, schema, table
from ocisac_fast.batch.jobs import Job, Jobs, Report, Work
from ocisac_fast.batch.measuring import build
from ocisac_fast.batch.recordings import Entry, find_recordings
from ocisac_fast.batch.results import Results, ResultsError, are_whole, failure_row, is_of, key_of, rows_name
from ocisac_fast.batch.task import Task
from ocisac_fast.batch.workers import Workers
from ocisac_fast.core.results import Result
from ocisac_fast.files.extras import pyarrow

MAX_FRAMES = 1000
_MAX_GROUP = 32  # recordings per task of Dask
_GROUPS_PER_THREAD = 8  # so that workers end at about the same time


@dataclass(frozen=True, repr=False)
class Progress(Result):
    """State of a run.

    Attributes:
        recordings: number of all.
        finished: those with all rows, those skipped included.
        skipped: those finished before.
        frames: measured in this run.
        failed: those that could not be read.
        new_failures: path and message of those that failed since the last report.
    """

    recordings: int
    finished: int
    skipped: int
    frames: int
    failed: int
    new_failures: tuple[tuple[str, str], ...]


@dataclass(frozen=True, repr=False)
class Outcome(Result):
    """Result of many recordings.

    Attributes:
        progress: numbers at the end.
        table: ``pyarrow.Table`` of all rows in the order of paths and frames; None where they are in a folder.
        failures: ``pyarrow.Table`` of path and message, in the order of paths.
    """

    progress: Progress
    table: Any
    failures: Any


def measure_recordings(
    paths: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    task: Task,
    *,
    client: Any = None,
    output: str | os.PathLike[str] | None = None,
    max_frames: int = MAX_FRAMES,
    again: bool = False,
    report: Callable[[Progress], object] | None = None,
) -> Outcome:
    """Measure many recordings; rows do not depend on workers, order or cuts.

    Args:
        paths: files, folders and patterns (``campaign/**/*.mkv``), also of fsspec's file systems.
        task: what is measured in each.
        client: what ``cluster`` yields, or a ``distributed.Client``; None: one recording after another in this process.
        output: results folder, which the workers write; what is finished there is skipped. None: rows are returned.
        max_frames: longer recordings are cut into stretches of about this length, at key frames, for ``gain`` and
            ``detect``; 0: none is cut.
        again: discard the results in ``output`` and measure everything anew.
        report: called after each recording or stretch.

    Raises:
        ResultsError: ``output`` cannot be written, or is of other options, and ``again`` is False.
        ClusterError, VersionError: the scheduler is lost, or workers have another version of this package.
    """
    if max_frames < 0:
        raise ValueError(f"max_frames: got {max_frames}, allowed: 0 or above")
    every = [os.fspath(path) for path in ((paths,) if isinstance(paths, (str, os.PathLike)) else paths)]
    entries = find_recordings(every)
    if output is None:
        return _Campaign(entries, task, None, max_frames, report).run(client)
    results = Results(output)
    if inside := [path for path in (*every, *task.inputs) if results.contains(path)]:
        raise ResultsError(f"output: got {results.folder}, which holds the input {inside[0]}; allowed: another folder")
    entries = [entry for entry in entries if not results.contains(entry.path)]
    with results.prepared(task, again, entries):
        return _Campaign(entries, task, results, max_frames, report).run(client)


def group_size(recordings: int, threads: int) -> int:
    """Recordings in a task: several where there are many, so that the scheduler keeps up."""
    return min(max(recordings // (_GROUPS_PER_THREAD * threads), 1), _MAX_GROUP)


@dataclass
class _Recording:
    """A recording of which stretches are in work."""

    left: int
    names: list[str] = field(default_factory=list)
    tables: list[tuple[int, Any]] = field(default_factory=list)
    is_spoilt: bool = False


@dataclass
class _Campaign:
    _entries: list[Entry]
    _task: Task
    _results: Results | None
    _max_frames: int
    _report: Callable[[Progress], object] | None
    _waiting: deque[Entry] = field(default_factory=deque)
    _stretches: deque[Job] = field(default_factory=deque)
    _open: dict[str, _Recording] = field(default_factory=dict)
    _tables: dict[str, Any] = field(default_factory=dict)
    _failures: dict[str, str] = field(default_factory=dict)
    _untold: list[tuple[str, str]] = field(default_factory=list)
    _failed_before: set[str] = field(default_factory=set)
    _present: dict[str, list[str]] = field(default_factory=dict)  # files of rows of unfinished recordings, by key
    _finished: int = 0
    _skipped: int = 0
    _frames: int = 0
    _group: int = 1

    def run(self, client: Any) -> Outcome:
        """Measure what is not finished."""
        self._look_at_results()
        folder = None if self._results is None else self._results.folder
        is_here = client is None or isinstance(client, Workers)
        locks = self._results.locks if self._results is not None and is_here else ()
        work = Work(self._task, folder, self._max_frames, build(), client is not None, locks)
        self._tell()
        if self._waiting:
            with contextlib.closing(self._batches(work, client)) as batches:
                for reports in batches:
                    for each in reports:
                        self._take(each)
                        self._tell()
        return self._outcome()

    def _batches(self, work: Work, client: Any) -> Generator[list[Report]]:
        if client is None:
            return in_this_process(work, self._next_jobs)
        if isinstance(client, Workers):
            return client.run(work, self._next_jobs)
        self._group = group_size(len(self._waiting), thread_count(client))
        return on_cluster(client, work, self._next_jobs)

    def _look_at_results(self) -> None:
        """Skip what is finished; remove rows of files that changed since."""
        if self._results is None:
            self._waiting.extend(self._entries)
            return
        self._failed_before = set(self._results.names("failures"))
        rows = self._results.checked_names(self._task)
        by_key: dict[str, list[str]] = {}
        for name in rows:
            by_key.setdefault(key_of(name), []).append(name)
        stale = []
        for entry in self._entries:
            names = by_key.pop(entry.key, [])
            present = [name for name in names if is_of(name, entry) and rows[name]]
            whole = rows_name(entry, None, None)
            if whole in present:  # and stretches, where the run ended before they were removed
                present = [whole]
            stale += [name for name in names if name not in present]
            if are_whole(present):
                self._finished += 1
                self._skipped += 1
            else:
                self._waiting.append(entry)
                if present:
                    self._present[entry.key] = present
        self._remove(stale)
        if self._waiting and self._task.command == "clean":
            self._results.remove_cleaned({entry.key for entry in self._waiting})

    def _next_jobs(self) -> Jobs:
        if self._stretches:
            return (self._stretches.popleft(),)
        cut = self._max_frames > 0
        return tuple(Job(self._waiting.popleft(), cut) for _ in range(min(self._group, len(self._waiting))))

    def _take(self, report: Report) -> None:
        job = report.job
        if self._results is not None and report.written:
            self._results.note(report.written)
        if report.stretches:
            self._begin(job, report.stretches)
            return
        if job.part is not None:
            self._take_stretch(job, report)
            return
        if report.failure is not None:
            self._fail(job.entry, report.failure)
            return
        self._frames += report.frames
        self._remove(self._present.pop(job.entry.key, []))  # stretches of an earlier run
        self._finish(job.entry, report.table)

    def _begin(self, job: Job, stretches: Jobs) -> None:
        """Queue the stretches of a recording that are not finished."""
        names = {each.name for each in stretches}
        present = set(self._present.pop(job.entry.key, []))
        self._remove(present - names)  # of other cuts
        left = [each for each in stretches if each.name not in present]
        self._open[job.entry.path] = _Recording(len(left), sorted(names))
        self._stretches.extend(left)
        if not left:
            self._end_stretches(job)

    def _take_stretch(self, job: Job, report: Report) -> None:
        recording = self._open[job.entry.path]
        recording.left -= 1
        recording.is_spoilt |= report.failure is not None
        self._frames += report.frames
        if job.part is not None and report.table is not None:
            recording.tables.append((job.part.first, report.table))
        if recording.left == 0:
            self._end_stretches(job)

    def _end_stretches(self, job: Job) -> None:
        """All stretches came back. Where one cannot be read by itself, the whole decides."""
        recording = self._open.pop(job.entry.path)
        if recording.is_spoilt:
            self._remove(recording.names)
            self._stretches.appendleft(Job(job.entry, is_cut=False))
            return
        tables = [each for _, each in sorted(recording.tables, key=lambda pair: pair[0])]
        self._finish(job.entry, pyarrow().concat_tables(tables) if tables else None)

    def _finish(self, entry: Entry, rows: Any) -> None:
        self._finished += 1
        if rows is not None:
            self._tables[entry.path] = rows
        name = f"failures/{entry.key}.parquet"
        if name in self._failed_before:
            self._remove([name])

    def _fail(self, entry: Entry, message: str) -> None:
        self._failures[entry.path] = message
        self._untold.append((entry.path, message))
        if self._results is not None:
            self._remove(self._present.pop(entry.key, []))
            self._results.write_failure(entry, message)

    def _remove(self, names: Iterable[str]) -> None:
        if self._results is not None:
            self._results.remove(names)

    def _tell(self) -> None:
        if self._report is not None:
            self._report(self._progress())
            self._untold.clear()

    def _progress(self) -> Progress:
        failed = len(self._failures)
        return Progress(len(self._entries), self._finished, self._skipped, self._frames, failed, tuple(self._untold))

    def _outcome(self) -> Outcome:
        rows = None
        if self._results is None:
            arrow = pyarrow()
            empty = schema(columns(self._task.command, self._task.picture)).empty_table()
            rows = arrow.concat_tables([empty, *(self._tables[path] for path in sorted(self._tables))])
        failed = table([failure_row(*pair) for pair in sorted(self._failures.items())], FAILURE)
        return Outcome(self._progress(), rows, failed)
