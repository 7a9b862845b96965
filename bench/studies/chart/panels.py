"""A panel for each scene: error of every method over its time, and the Pareto front."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ocisac_fast import _core
from studies.chart.measuring import Bytes, Timing, in_turn, one_thread, pool_of_frames, rms
from studies.chart.methods import GAIN_METHODS, GainMethod
from studies.chart.scenes import SCENES, Scene

FAST_TONE = Scene("rows-added", "Rows added: D = 1, 2, 4, 8 (f·T_r = 0.06)", 65.3)  # off any bin
COST, ERROR = "time per frame / time of reading it", "RMS error / Cramér-Rao bound"


@dataclass(frozen=True)
class Point:
    """One method in one scene."""

    scene: str
    method: GainMethod
    cost: float  # seconds over those of reading the frame
    error: float  # RMS over the Cramér-Rao bound
    seconds: float  # per call

    @property
    def family(self) -> str:
        """Methods that share a marker."""
        return self.method.series.removeprefix("fit, ") if self.scene == FAST_TONE.name else self.method.family


Measured = Sequence[tuple[Scene, Sequence[Point]]]


@functools.cache
def _pool(rows: int, columns: int) -> list[Bytes]:
    return pool_of_frames((rows, columns))


@functools.cache
def _timing(method: GainMethod, scene: Scene, seconds: float) -> Timing:
    """Timing for a full frame from memory."""
    with one_thread():
        return in_turn(method.prepare(scene), _core.read_bytes, _pool(scene.rows, scene.columns), seconds)


def measure_scene(
    scene: Scene, methods: Sequence[GainMethod], columns: int, frames: int, seconds: float
) -> Iterator[Point]:
    """Measure every installed method in one scene: its error in narrower frames, its time in whole ones."""
    bound = scene.bound()
    narrower = dataclasses.replace(scene, columns=columns)
    every = list(narrower.frames(frames))
    for method in methods:
        if method.installed:
            estimate = method.prepare(narrower)
            error = rms([estimate(frame) - scene.gain for frame in every]) / bound
            timing = _timing(method, scene if method.timed_per_scene else SCENES[0], seconds)
            yield Point(scene.name, method, timing.ratio, error, timing.seconds)


def measure(columns: int, frames: int, seconds: float, done: Callable[[str], object]) -> Measured:
    """All scenes with their points; the last one, in which adding rows costs accuracy, holds the fits alone."""
    fits = [method for method in GAIN_METHODS if method.family == "fit" and ", D=" in method.name]
    measured = []
    for scene in (*SCENES, FAST_TONE):
        methods, count = (fits, 2 * frames) if scene is FAST_TONE else (GAIN_METHODS, frames)
        measured.append((scene, list(measure_scene(scene, methods, columns, count, seconds))))
        done(scene.title)
    return measured


def pareto_front(points: Sequence[Point]) -> list[Point]:
    """Points that no other beats in cost and error, by ascending cost."""
    front: list[Point] = []
    for point in sorted(points, key=lambda p: (p.cost, p.error)):
        if point.error < (front[-1].error if front else np.inf):
            front.append(point)
    return front


def beaten_by(point: Point, points: Sequence[Point], cost: float = 0.1, error: float = 0.03) -> Point | None:
    """Another point that is no slower and no less accurate, and better in one by more than the measurement's spread."""
    for other in points:
        no_worse = other.cost <= point.cost and other.error <= point.error
        if no_worse and (other.cost < (1.0 - cost) * point.cost or other.error < (1.0 - error) * point.error):
            return other
    return None


def best_of_families(points: Sequence[Point]) -> list[Point]:
    """For each family the fastest of the points within 3 % of the most accurate one; sorted by error."""
    chosen = []
    for family in dict.fromkeys(point.family for point in points):
        own = [point for point in points if point.family == family]
        least = min(point.error for point in own)
        chosen.append(min((p for p in own if p.error <= 1.03 * least), key=lambda p: p.cost))
    return sorted(chosen, key=lambda p: p.error)


def best_fit(points: Sequence[Point]) -> tuple[Point, Point | None]:
    """The fastest fit within 5 % of the most accurate one, and a method other than a fit that beats it."""
    fits = [point for point in points if point.family.startswith("fit")]
    least = min(fit.error for fit in fits)
    fit = min(best_of_families(fits), key=lambda p: (p.error > 1.05 * least, p.cost))
    return fit, beaten_by(fit, [point for point in points if point not in fits])
