"""A panel of scenes: time per frame and error, planned to a tolerance and by brute force."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ocisac_fast import reference
from ocisac_fast.camera.camera import Camera
from ocisac_fast.light.waveforms import SquareWave
from ocisac_fast.scene import Ambient, Disc, Grating, Pinhole, Plan, Pose, Ring, Scene, Sensor, Source, Surface, render
from studies.chart.measuring import Point, in_turn, root_mean_square
from studies.chart.panels import Effort, Progress, panel

_TOLERANCES = (0.1, 0.5, 2.0, 10.0)
_SUBEXPOSURES = (4, 16, 64)
_EXACT = 1e-3  # DN


def testbed(columns: int) -> Scene:
    """The paper's testbed (table 2): an LED in a ring of bars, 180 rows for 270 columns; light up to 140 DN."""
    exposure, place = 2404e-6, Pose((0.0, 0.0, 0.3))
    led = Source(Disc(0.08), place, SquareWave(500.0))
    ring = Surface(Ring(0.15, 0.04), place, pattern=Grating(100.0), speed=1.751)
    lens = Pinhole(columns=columns, rows=columns * 2 // 3, focal_length=4e-3, pixel_pitch=3.65e-6 * 1080 / columns)
    return Scene(
        lens, Camera(22.2e-6, exposure), Sensor(200 / exposure), sources=[led], surfaces=[ring], ambient=Ambient(0.7)
    )


@panel(
    "scenes",
    "Frame of a scene",
    "time / ms",
    "RMS error / DN",
    steps=len(_TOLERANCES) + len(_SUBEXPOSURES),
)
def measure_scenes(effort: Effort, progress: Progress) -> list[Point]:
    """Measure plans at several tolerances, labelled in DN, and brute force, labelled by the number of sub-exposures."""
    scene = testbed(min(effort.columns, 540))
    truth = next(render(scene.plan(tolerance=_EXACT)))
    calls: list[tuple[str, str, str, Callable[[], Any]]] = []
    for tolerance in _TOLERANCES:
        calls.append((f"plan, {tolerance:g} DN", "plan", f"{tolerance:g}", _frame_of(scene.plan(tolerance=tolerance))))
    for count in _SUBEXPOSURES:
        calls.append((f"brute force, {count}", "brute force", f"{count}", _brute_force_of(scene, count)))
    points = []
    for method, family, label, call in calls:
        error = root_mean_square(np.asarray(call(), np.float64) - truth)
        took = _seconds(call, effort.seconds)
        points.append(Point("scenes", method, family, family, label, "float64", took * 1e3, error, took))
        progress(method)
    return points


def _seconds(call: Callable[[], Any], seconds: float) -> float:
    return in_turn(lambda _: call(), lambda _: None, [None], seconds, (1, 100)).seconds


def _frame_of(plan: Plan) -> Callable[[], Any]:
    return lambda: next(render(plan))


def _brute_force_of(scene: Scene, count: int) -> Callable[[], Any]:
    return lambda: reference.render_scene(scene, subexposures=count)[0]
