"""``ocisac batch``."""

from __future__ import annotations

import contextlib
import functools
import math
import os
import shlex
import time
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import click
import numpy as np

from ocisac_fast.batch.campaign import MAX_FRAMES, Progress, measure_recordings
from ocisac_fast.batch.engines import cluster
from ocisac_fast.batch.fields import FIELDS
from ocisac_fast.batch.jobs import ClusterError, VersionError
from ocisac_fast.batch.recordings import find_recordings
from ocisac_fast.batch.results import OWN, Results
from ocisac_fast.batch.summary import summarize
from ocisac_fast.batch.task import Task
from ocisac_fast.cli.command import command
from ocisac_fast.cli.errors import SOME_FAILED
from ocisac_fast.cli.output import emit, emit_facts, emit_json, emit_table, facts_of, with_spread
from ocisac_fast.cli.outputs import INPUT, OUTPUT, InputFile, OutputFolder, draw, label, output_files
from ocisac_fast.cli.text import one_line
from ocisac_fast.cli.units import ParameterType

_SUMMARY = "summary.png"  # in the folder of the results
_MAX_LINES = 40  # of recordings and of failures in a summary


class _TaskWords(ParameterType):
    name = "COMMAND"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return value if isinstance(value, Task) else Task.from_words(shlex.split(value))


class _Recordings(InputFile):
    kind = "file or folder"

    def files(self, path: str | os.PathLike[str]) -> Iterator[str]:
        with contextlib.suppress(ValueError):  # none there, which is said later
            yield from (entry.path for entry in find_recordings(path))


_RECORDINGS = _Recordings(readable=False)


class _BatchCommand(click.Command):
    """A command whose words from the first name of a task on are the task's."""

    def make_parser(self, ctx: click.Context) -> Any:
        parser = super().make_parser(ctx)
        with_values = {
            word
            for param in self.params
            if isinstance(param, click.Option) and not param.is_flag
            for word in param.opts
        }
        parse = parser.parse_args

        def parse_args(args: list[str]) -> Any:
            own, task = _split(args, with_values)
            return parse([*own, *(["--task", shlex.join(task)] if task else [])])

        parser.parse_args = parse_args  # type: ignore[method-assign]
        return parser

    def collect_usage_pieces(self, ctx: click.Context) -> list[str]:
        return [*super().collect_usage_pieces(ctx), "COMMAND [OPTIONS]"]


def _split(words: Sequence[str], with_values: set[str]) -> tuple[list[str], list[str]]:
    """Words of ``batch``, and from the first name of a command on those of the task."""
    places = [k for k, word in enumerate(words) if word in FIELDS and (k == 0 or words[k - 1] not in with_values)]
    for place in places:
        if place == places[-1] or not os.path.exists(words[place]):  # else a recording of this name
            return list(words[:place]), list(words[place:])
    return list(words), []


@functools.partial(command, kind=_BatchCommand)
def batch(
    recordings: Annotated[tuple[str, ...], _RECORDINGS, {"metavar": "RECORDINGS...", "nargs": -1}] = (),
    *,
    output: Annotated[
        str | None,
        OutputFolder(readable=False),
        {"names": ["-o", "--output"], "metavar": "FOLDER"},
        "Results; what is finished there is skipped.",
    ] = None,
    scheduler: Annotated[
        str | None, {"metavar": "ADDRESS"}, "Dask scheduler (tcp://host:8786) or its file (.json)."
    ] = None,
    workers: Annotated[int | None, click.IntRange(0), "Processes on this machine  [default: its processors]"] = None,
    max_frames: Annotated[
        int, click.IntRange(0), "Longer recordings are cut into stretches for gain and detect; 0: never."
    ] = MAX_FRAMES,
    again: Annotated[bool, "Discard the results in FOLDER."] = False,
    summary: Annotated[
        str | None, INPUT, {"metavar": "FOLDER"}, "Print and draw what came out, and measure nothing."
    ] = None,
    plot: Annotated[str | None, OUTPUT, "Picture of the summary  [default: FOLDER/summary.png]"] = None,
    task: Annotated[Task | None, _TaskWords(), {"hidden": True}] = None,
    as_json: bool,
) -> None:
    """Run COMMAND on many RECORDINGS: files, folders, patterns in quotes ('campaign/**/*.mkv'), URLs of fsspec.

    COMMAND is gain, receive, detect, sense, calibrate or clean with its options. FOLDER gets a Parquet dataset whose
    columns are those of --json, for gain with a row for each frame. Recordings that cannot be read are listed in
    FOLDER/failures; the exit code is then 3. After an interrupt the same command goes on.
    """
    _require_apart(summary or output)
    if summary is not None:
        _summarize(summary, plot, as_json)
        return
    if task is None:
        raise click.UsageError(f"COMMAND: got none, allowed: {', '.join(FIELDS)}")
    if not recordings:
        raise click.UsageError("RECORDINGS: got none, allowed: files, folders or patterns before the command")
    if output is None:
        raise click.UsageError("--output: needed")
    try:
        with cluster(scheduler=scheduler, workers=workers) as client, _shown() as report:
            done = measure_recordings(
                recordings, task, client=client, output=output, max_frames=max_frames, again=again, report=report
            )
    except (ClusterError, VersionError) as error:
        raise click.ClickException(str(error)) from error
    except KeyboardInterrupt:
        click.echo(f"ocisac: interrupted; {output} keeps what is finished, the same command goes on", err=True)
        raise
    facts = facts_of(done.progress, "recordings finished skipped failed frames")
    lines = {"results": output, **{name: str(value) for name, value in facts.items()}}
    emit(as_json, {"output": output, **facts}, lines)
    if done.progress.failed:
        raise click.exceptions.Exit(SOME_FAILED)


def _require_apart(folder: str | None) -> None:
    """Refuse outputs among files of results, which they would replace, or join in the dataset."""
    for param, path in output_files():
        if folder is not None and any(Results(f"{folder}/{name}").contains(path) for name in OWN):
            raise click.UsageError(f"{label(param)}: got {path}, which is among the results, allowed: another folder")


@contextlib.contextmanager
def _shown() -> Iterator[Any]:
    """A function that shows progress on standard error: a bar on a terminal, and a line for each failure."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress as Bars, TextColumn, TimeRemainingColumn

    console = Console(stderr=True, highlight=False, soft_wrap=True)
    columns = (TextColumn("recordings"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[speed]}"))
    began = time.monotonic()
    with Bars(
        *columns, TimeRemainingColumn(), console=console, transient=True, disable=not console.is_terminal
    ) as bars:
        bar = bars.add_task("", total=None, speed="")

        def report(progress: Progress) -> None:
            rate = progress.frames / max(time.monotonic() - began, 1e-3)
            ended = progress.finished + progress.failed
            bars.update(bar, total=progress.recordings, completed=ended, speed=f"{rate:.0f} frames/s")
            for path, message in progress.new_failures:
                console.print(one_line(f"ocisac: failed: {path}: {message}"), markup=False)

        yield report


def _is_drawn(path: str) -> bool:
    """True for a picture that this package drew: an earlier one of a summary."""
    from ocisac_fast.plots.picture import CREATOR

    if os.path.islink(path) or not os.path.isfile(path):
        return False
    with open(path, "rb") as file:
        begin = file.read(256)
    return begin.startswith(b"\x89PNG") and CREATOR.encode() in begin


def _summarize(folder: str, plot: str | None, as_json: bool) -> None:
    found = summarize(folder)
    path = plot or (f"{folder.rstrip('/')}/{_SUMMARY}" if Results(folder).is_local else None)
    if path is not None:
        force = plot is not None or click.get_current_context().params["force"]
        if os.path.lexists(path) and not (force or _is_drawn(path)):
            raise click.UsageError(
                f"--summary: got {path}, which is no picture of it, allowed: --plot FILE, or --force"
            )
        values, spreads = (np.array([getattr(one, name) for one in found.recordings]) for name in ("value", "spread"))
        draw(path, "plot_recordings", values, spreads, label=found.label, flags=found.flags)
    if as_json:
        for one in found.recordings:
            value = {"of": found.label, "value": one.value, "value_std": one.spread}
            emit_json({**facts_of(one, "path frames"), **value, "flags": dict(one.flags), "warnings": one.warnings})
        for failed, message in found.failures:
            emit_json({"path": failed, "failure": message})
        return
    shown = found.recordings[:_MAX_LINES]
    rows = [[one.path, str(one.frames), _value(one.value, one.spread), ", ".join(sorted(one.flags))] for one in shown]
    emit_table("", ("recording", "frames", found.label, "flags"), rows, left=("flags",))
    _more(len(found.recordings))
    facts = {
        "recordings": f"{len(found.recordings)} with results, {len(found.failures)} failed",
        "flags": ", ".join(f"{name} in {count}" for name, count in found.flags.most_common()) or "none",
        "incomplete": str(sum(bool(one.warnings) for one in found.recordings)),
        **({} if path is None else {"picture": path}),
    }
    emit_facts("", facts)
    if found.failures:
        emit_table("", ("failed", "message"), found.failures[:_MAX_LINES], left=("message",))
        _more(len(found.failures))


def _value(value: float, spread: float) -> str:
    return with_spread(value, None if math.isnan(spread) else spread, "", 5)


def _more(count: int) -> None:
    if count > _MAX_LINES:
        click.echo(f"and {count - _MAX_LINES} more; --json lists all")
