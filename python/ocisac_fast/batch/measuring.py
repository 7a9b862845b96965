"""From one recording, or a stretch of it, to rows: pure functions, which no other recording changes."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any

from ocisac_fast import __version__, _core
from ocisac_fast.batch.fields import columns, table
from ocisac_fast.batch.recordings import content_hash
from ocisac_fast.batch.task import IN_STRETCHES, Task
from ocisac_fast.camera.camera import Camera
from ocisac_fast.cli import detect, gain
from ocisac_fast.cli.output import collected_objects, plain
from ocisac_fast.cli.pictures import open_pictures
from ocisac_fast.files import FileWarning, Part, cut_recording, open_recording


def measure_recording(path: str, task: Task, *, cleaned: str | None = None) -> Any:
    """Measure one recording.

    Args:
        path: of a recording; fsspec's paths, such as ``s3://bucket/lamp.mkv``, too.
        task: what is measured.
        cleaned: file that ``clean`` writes.

    Returns:
        ``pyarrow.Table``: the objects of the command's ``--json``, for ``gain`` one a frame, with the path before them.

    Raises:
        FileError, OSError: it cannot be read; other ValueErrors as from the command.
    """
    return Measurement.of(path, task, cleaned=cleaned).table


@dataclass(frozen=True)
class Start:
    """Estimates from a recording's first frames, and its hash, which all its stretches share."""

    light: Any  # of gain; None for other commands
    scan_axis: str
    digest: dict[str, str]


@dataclass(frozen=True)
class Measurement:
    """Rows of a recording or a stretch."""

    table: Any  # pyarrow.Table
    facts: dict[str, Any]  # the recording and how it was measured, as JSON

    @classmethod
    def of(
        cls, path: str, task: Task, *, part: Part | None = None, start: Start | None = None, cleaned: str | None = None
    ) -> Measurement:
        """Measure; ``start`` is needed for a part."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            rows = _rows(path, task, part, start, cleaned)
        digest = content_hash(path) if start is None else start.digest  # once it is known to be a recording
        picture = task.picture
        with open_recording(path, raw=picture.raw) as stream:
            camera = picture.camera(stream)
        is_cleaned = cleaned is not None and os.path.exists(cleaned)  # else every frame stays as it is
        names = plain({"path": path, **({"cleaned": cleaned} if is_cleaned else {})})
        named = [{**names, **row} for row in rows]
        facts = {
            "path": path,
            **digest,
            "frames": _frame_count(task.command, rows),
            "part": None if part is None else [part.first, part.stop],
            "warnings": [str(each.message) for each in caught if issubclass(each.category, FileWarning)],
            "camera": {one.name: getattr(camera, one.name) for one in fields(Camera) if one.init},
            "task": task.facts(),
            "build": build(),
        }
        return cls(table(named, columns(task.command, picture)), facts)


def start_of(path: str, task: Task, max_frames: int) -> tuple[list[Part], Start] | None:
    """Stretches of a long recording and what they share; None for one that is measured as a whole."""
    if task.command not in IN_STRETCHES:
        return None
    arguments, picture = task.arguments()
    parts = cut_recording(path, max_frames, raw=picture.raw)
    if parts is None:
        return None
    if task.command == "detect":
        with open_pictures(path, picture) as pictures:
            return parts, Start(None, pictures.camera.scan_axis, content_hash(path))
    light = gain.find_light(path, picture, arguments["frequency"], gain.tone_options(picture, **arguments))
    return None if math.isnan(light.frequency) else (parts, Start(light, light.scan_axis, content_hash(path)))


@cache
def build() -> dict[str, str]:
    """Version and commit of the package."""
    return {"version": __version__, "commit": _core.commit()}


def _rows(
    path: str, task: Task, part: Part | None, start: Start | None, cleaned: str | None
) -> list[Mapping[str, Any]]:
    if task.command not in IN_STRETCHES:
        with collected_objects() as rows:
            task.run(path, cleaned=cleaned)
            return list(rows)
    arguments, picture = task.arguments()
    if start is not None:
        picture = replace(picture, scan_axis=start.scan_axis)
    with collected_objects():  # without progress
        if task.command == "gain":
            light, first = None if start is None else start.light, 0 if part is None else part.first
            options = gain.tone_options(picture, **arguments)
            gains = gain.frame_gains(path, picture, arguments["frequency"], options, part, light)
            every = gains.every_frame(first, arguments["background"] is not None)
            return [plain(picture.in_units(row)) for row in every]
        options = {name: arguments[name] for name in ("false_alarms", "min_cycles")}
        # each frame by itself: the same in any stretch
        return [plain(row) for row in detect.detected_lights(path, picture, options, part=part, group=1)]


def _frame_count(command: str, rows: list[Mapping[str, Any]]) -> int | None:
    """Frames with an answer; None: not stated by the command."""
    if command in ("sense", "calibrate"):
        return sum(int(row["frames"]) for row in rows)
    return len({row["frame"] for row in rows if row["frame"] is not None})
