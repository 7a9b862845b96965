"""Jobs that workers run: from a recording, or a stretch of it, to a file of rows and a short report."""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import click

from ocisac_fast.batch.measuring import Measurement, Start, build, start_of
from ocisac_fast.batch.recordings import Entry, present_state, require_file
from ocisac_fast.batch.results import Results, ResultsError, rows_name
from ocisac_fast.batch.task import Task
from ocisac_fast.cli.errors import error_text, input_errors
from ocisac_fast.cli.text import one_line
from ocisac_fast.files import FileError, Part
from ocisac_fast.files.extras import pyarrow
from ocisac_fast.files.reading import lossless_suffix
from ocisac_fast.files.remote import is_remote
from ocisac_fast.files.videos import decoder_threads

# Pictures are opened with standard error turned away, which is the process's: threads of a worker take turns.
_one_at_a_time = threading.Lock()


class ClusterError(RuntimeError):
    """A scheduler that is not there or was lost, or workers that cannot be used; one line."""


class VersionError(RuntimeError):
    """A worker with another ocisac_fast than the client's."""


@dataclass(frozen=True)
class Job:
    """A recording, or with ``part`` a stretch of it."""

    entry: Entry
    is_cut: bool = True  # False: the recording is measured as a whole, however long it is
    part: Part | None = None
    frame_count: int | None = None
    start: Start | None = None
    state: str | None = None  # of the recording as its first job began; a listing may describe it in other words

    @property
    def name(self) -> str:
        """Name of the file of rows."""
        return rows_name(self.entry, self.part, self.frame_count)


Jobs = tuple[Job, ...]


@dataclass(frozen=True)
class Report:
    """Result of a job."""

    job: Job
    frames: int = 0  # measured
    failure: str | None = None  # why the recording could not be read
    stretches: Jobs = ()  # jobs in place of this one, whose recording is long
    table: Any = None  # rows, where there is no results folder
    written: Mapping[str, int] = field(default_factory=dict)  # lengths of files, by name below the results folder


@dataclass(frozen=True)
class Work:
    """Settings that all jobs share."""

    task: Task
    folder: str | None  # of the results; None: tables are in the reports
    max_frames: int  # longer recordings are cut into stretches of about this length
    client_build: dict[str, str]  # version and commit that workers must have
    is_one_of_several: bool  # False: the process has the machine for itself
    locks: tuple[int, ...] = ()  # of the folder: descriptors that processes of this machine hold too, to their end

    def __call__(self, jobs: Jobs) -> list[Report]:
        """Do the jobs one after the other.

        Raises:
            ResultsError: the results cannot be written.
            ValueError: options that fit no recording.
            VersionError: this process has another version of the package than the client.
        """
        if build() != self.client_build:
            here, there = (" ".join(each.values()) for each in (build(), self.client_build))
            raise VersionError(f"ocisac_fast: a worker has {here}, this process {there}; allowed: the same")
        results = None if self.folder is None else Results(self.folder, self.locks)
        # Workers share a machine, a process for each processor: one thread decodes.
        with _one_at_a_time, decoder_threads(1 if self.is_one_of_several else 0):
            return [self._report(job, results) for job in jobs]

    def _report(self, job: Job, results: Results | None) -> Report:
        held = None if results is None else results.holds(job.name, self.task)
        if held is not None:  # by a worker that was lost before its report arrived
            facts, written = held
            return Report(job, frames=facts["frames"] or 0, written=written)
        try:
            return self._measured(job, results)
        except (ResultsError, VersionError):
            raise
        except click.UsageError as error:
            raise ValueError(error.format_message()) from error
        except Exception as error:  # whatever a recording provokes, the others are measured
            if results is not None:
                results.remove([job.name])  # whose cleaned file has no name
            self.task.require_inputs()
            text = error_text(error) if isinstance(error, input_errors()) else f"{type(error).__name__}: {error}"
            return Report(job, failure=one_line(text.removeprefix(f"{job.entry.path}: ")))

    def _measured(self, job: Job, results: Results | None) -> Report:
        path = job.entry.path
        if job.entry.failure:
            raise FileError(job.entry.failure)
        require_file(path)
        job = replace(job, state=job.state or (present_state(path) if is_remote(path) else job.entry.state))
        if job.part is None and job.is_cut:
            cut = start_of(path, self.task, self.max_frames)
            if cut is not None:
                parts, start = cut
                common = replace(job, frame_count=parts[-1].stop, start=start)
                return Report(job, stretches=tuple(replace(common, part=part) for part in parts))
        if self.task.command == "clean" and results is not None:
            suffix = lossless_suffix(path, raw=self.task.picture.raw)
            with results.cleaned(job.entry, suffix) as (local, name, final):
                found = Measurement.of(path, self.task, cleaned=local)
                if os.path.exists(local):  # else every frame stays as it is
                    found.facts["cleaned"] = {name: os.stat(local).st_size}
                    found = replace(found, table=_with_cleaned(found.table, final))
                return self._written(job, found, results)
        return self._written(job, Measurement.of(path, self.task, part=job.part, start=job.start), results)

    def _written(self, job: Job, found: Measurement, results: Results | None) -> Report:
        self.task.require_inputs()
        if job.state != present_state(job.entry.path):
            raise FileError("changed while it was measured")
        frames = found.facts["frames"] or 0
        if results is None:
            return Report(job, frames=frames, table=found.table)
        facts = {**found.facts, "size": job.entry.size, "state": job.entry.state}
        written = {**facts.get("cleaned", {}), **results.write_rows(job.name, found.table, facts)}
        return Report(job, frames=frames, written=written)


def _with_cleaned(table: Any, path: str) -> Any:
    place = table.schema.get_field_index("cleaned")
    values = pyarrow().array([path] * len(table), table.schema.field(place).type)
    return table.set_column(place, table.schema.field(place), values)
