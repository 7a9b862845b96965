"""What came out of many recordings: one value of each, flags, failures."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from ocisac_fast.batch.results import Results, read_failures
from ocisac_fast.core.results import Result
from ocisac_fast.core.statistics import mean_and_std


class RecordingSummary(NamedTuple):
    """One recording.

    Attributes:
        path: of the recording.
        frames: with an answer.
        value, spread: its value and standard error; NaN: unknown.
        flags: number of rows by flag.
        warnings: of the reading, such as of a truncated video.
    """

    path: str
    frames: int
    value: float
    spread: float
    flags: Counter[str]
    warnings: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class Summary(Result):
    """Summary of a results folder.

    Attributes:
        command: the task's.
        label: name of the value.
        recordings: in the order of paths.
        failures: path and message, in the order of paths.
    """

    command: str
    label: str
    recordings: list[RecordingSummary]
    failures: list[tuple[str, str]]

    @property
    def flags(self) -> Counter[str]:
        """Number of recordings by flag."""
        return Counter(flag for one in self.recordings for flag in one.flags)


def summarize(folder: str | os.PathLike[str]) -> Summary:
    """Summarize a results folder, one recording in memory at a time.

    Raises:
        ResultsError: no results folder.
    """
    results = Results(folder)
    command = results.task_facts()["command"]
    label, value_of = _VALUES[command]
    by_path = groupby(results.every_part(), key=lambda part: str(part[0]["path"]))
    recordings = [_summary(path, list(parts), value_of) for path, parts in by_path]
    failures = [(row["path"], row["message"]) for row in read_failures(folder).to_pylist()]
    return Summary(command, label, sorted(recordings, key=lambda one: one.path), failures)


def _summary(path: str, parts: list[Any], value_of: Callable[[list[Any]], tuple[float, float]]) -> RecordingSummary:
    rows = [row for _, table in parts for row in table.to_pylist()]
    frames = sum(facts["frames"] or 0 for facts, _ in parts)
    flags = Counter(flag for row in rows for flag in _flags(row))
    caught = tuple(text for facts, _ in parts for text in facts["warnings"])
    return RecordingSummary(path, frames, *value_of(rows), flags, caught)


def _flags(row: dict[str, Any]) -> set[str]:
    nested = [*(row.get("sources") or ()), *(row.get("regions") or ())]
    return {flag for one in (row, *nested) for flag in one.get("flags") or ()}


def _numbers(rows: list[Any], name: str) -> Any:
    return np.array([math.nan if row[name] is None else row[name] for row in rows], np.float64)


def _mean_of(name: str) -> Callable[[list[Any]], tuple[float, float]]:
    def value(rows: list[Any]) -> tuple[float, float]:
        found = _numbers(rows, name)
        found = found[np.isfinite(found)]
        return (float(found.mean()) if found.size else math.nan), math.nan

    return value


def _number_of(name: str) -> Callable[[list[Any]], tuple[float, float]]:
    return lambda rows: (sum(len(row[name]) for row in rows) / len(rows) if rows else math.nan, math.nan)


_VALUES: dict[str, tuple[str, Callable[[list[Any]], tuple[float, float]]]] = {
    "gain": ("gain", lambda rows: mean_and_std(_numbers(rows, "gain"), _numbers(rows, "gain_std"))),
    "receive": ("SNR / dB", _mean_of("snr_db")),
    "detect": ("lights per frame", _number_of("sources")),
    "sense": ("regions", _number_of("regions")),
    "calibrate": (
        "row time / s",
        lambda rows: (float(_numbers(rows, "row_time_s")[0]), float(_numbers(rows, "row_time_std_s")[0])),
    ),
    "clean": ("share", _mean_of("share")),
}
