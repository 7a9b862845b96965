"""Panels of the gain methods, one per scene."""

from __future__ import annotations

import dataclasses
import functools

from studies.chart.measuring import Bytes, Point, Timing, one_thread, pool_of_frames, read_in_turn, root_mean_square
from studies.chart.methods import GAIN_METHODS, GainMethod
from studies.chart.panels import Effort, Progress, panel
from studies.chart.scenes import SCENES, Scene

_timings: dict[tuple[str, str, float], Timing] = {}


@functools.cache
def _pool(rows: int, columns: int) -> list[Bytes]:
    return pool_of_frames((rows, columns))


def _timing(method: GainMethod, scene: Scene, seconds: float) -> Timing:
    """Timing for a full frame from memory; once for all scenes if it is independent of the frequency."""
    key = (method.name, scene.name if method.timed_per_scene else "", seconds)
    if key not in _timings:
        with one_thread():
            _timings[key] = read_in_turn(method.prepare(scene), _pool(scene.rows, scene.columns), seconds)
    return _timings[key]


def measure_gains(scene: Scene, effort: Effort, progress: Progress) -> list[Point]:
    """Measure every installed method in one scene."""
    bound = scene.bound()
    smaller = dataclasses.replace(scene, columns=effort.columns)
    frames = list(smaller.frames(effort.frames))
    points = []
    for method in GAIN_METHODS:
        if method.installed:
            estimate = method.prepare(smaller)
            error = root_mean_square([estimate(frame) - scene.gain for frame in frames]) / bound
            timing = _timing(method, scene, effort.seconds)
            about = (method.family, method.series, method.label, method.precision)
            points.append(Point(scene.name, method.name, *about, timing.ratio, error, timing.seconds))
        progress(f"{scene.title}: {method.name}")
    return points


_FAST_TONE = Scene("rows-added", "", 65.3)
_GROUPED = [m for m in GAIN_METHODS if m.family == "fit" and ", D=" in m.name]


def measure_rows_added(effort: Effort, progress: Progress) -> list[Point]:
    """Measure the fit at a frequency where adding rows reduces accuracy, on the same frames; off any bin."""
    bound = _FAST_TONE.bound()
    smaller = dataclasses.replace(_FAST_TONE, columns=effort.columns)
    frames = list(smaller.frames(2 * effort.frames))
    points = []
    for method in _GROUPED:
        estimate = method.prepare(smaller)
        error = root_mean_square([estimate(frame) - smaller.gain for frame in frames]) / bound
        timing = _timing(method, _FAST_TONE, effort.seconds)
        series = method.series.removeprefix("fit, ")
        about = (series, series, f"{method.row_group}", method.precision)
        points.append(Point("rows-added", method.name, *about, timing.ratio, error, timing.seconds))
        progress(method.name)
    return points


def _register() -> None:
    for scene in SCENES:
        panel(
            scene.name,
            scene.title,
            "time per frame / time of reading it",
            "RMS error / Cramér-Rao bound",
            steps=len(GAIN_METHODS),
            labelled=False,
            limits=True,
        )(functools.partial(measure_gains, scene))

    panel(
        "rows-added",
        "Rows added: D = 1, 2, 4, 8 (f·T_r = 0.06)",
        "time per frame / time of reading it",
        "RMS error / Cramér-Rao bound",
        steps=len(_GROUPED),
    )(measure_rows_added)


_register()
