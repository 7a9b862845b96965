"""Cost of a scene: time of a plan's frames compared with brute force and with writing memory; error over tolerance.

Times are the minimum of several; brute force (every pixel's voxel at 64 sub-exposures, in NumPy) runs once.
"""

from __future__ import annotations

import argparse
import dataclasses
import pathlib
import timeit
from collections.abc import Callable

import numpy as np

from ocisac_fast import Camera, SquareWave
from ocisac_fast.reference import render_scene
from ocisac_fast.scene import Pinhole, Plan, Pose, Rectangle, Scene, Sensor, Source, load_scene, render

TESTBED = pathlib.Path(__file__).resolve().parent.parent / "examples" / "testbed.toml"
REPEATS = 15


def shortest(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Minimum time of several runs, s."""
    return min(timeit.repeat(work, number=1, repeat=repeats))


def full_hd(scene: Scene) -> Scene:
    """The same view on 1920 x 1080 pixels."""
    lens = scene.lens
    pitch = lens.pixel_pitch * lens.rows / 1080
    return dataclasses.replace(scene, lens=dataclasses.replace(lens, columns=1920, rows=1080, pixel_pitch=pitch))


def one_source() -> Scene:
    """A uniform light that fills half the width of the picture."""
    camera = Camera(15e-6, 500e-6, 1 / 30)
    source = Source(Rectangle(1, 2), Pose((0, 0, 1)), SquareWave(2000))
    return Scene(
        Pinhole(columns=1920, rows=1080, focal_length=4e-3, pixel_pitch=4.2e-6),
        camera,
        Sensor(200 / 500e-6, bit_depth=8),
        sources=[source],
    )


def frame_of(plan: Plan) -> np.ndarray:
    return next(render(plan, frames=1))


def main() -> None:
    arguments = argparse.ArgumentParser(description="Costs of scenes.")
    arguments.add_argument("--tolerances", action="store_true", help="time and error over tolerances")
    options = arguments.parse_args()
    testbed = full_hd(load_scene(TESTBED))
    start = timeit.default_timer()
    expected = render_scene(testbed, subexposures=64)[0]
    brute = timeit.default_timer() - start
    plan = testbed.plan(tolerance=0.5)
    frame = shortest(lambda: frame_of(plan))
    planned = shortest(lambda: testbed.plan(tolerance=0.5), 3)
    print("1920 x 1080 pixels, times in ms")
    print(f"testbed, brute force of 64 sub-exposures: {brute * 1e3:9.1f}")
    print(f"testbed, tolerance 0.5 DN:                {frame * 1e3:9.1f}  {brute / frame:.0f} times faster")
    print(f"testbed, its plan, once:                  {planned * 1e3:9.1f}")
    light = one_source().plan(tolerance=0.5)
    memory = np.empty((1080, 1920), np.uint8)
    written = shortest(lambda: memory.fill(7), 200)
    made = shortest(lambda: frame_of(light), 200)
    print(f"a frame written to memory:                {written * 1e3:9.3f}")
    print(f"one source, tolerance 0.5 DN:             {made * 1e3:9.3f}  {made / written:.1f} times that")
    if options.tolerances:
        tolerances(dataclasses.replace(testbed, sensor=Sensor(testbed.sensor.gain)), expected)  # before rounding


def tolerances(scene: Scene, expected: np.ndarray) -> None:
    print("tolerance (DN)  bound (DN)  from 64 sub-exposures (DN, rms)  time (ms)")
    for tolerance in (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0):
        plan = scene.plan(tolerance=tolerance)
        error = frame_of(plan) - expected
        cost = shortest(lambda plan=plan: frame_of(plan), 5)
        print(f"{tolerance:14g}  {plan.bound:10.3g}  {np.sqrt(np.mean(error**2)):31.3g}  {cost * 1e3:9.1f}")


if __name__ == "__main__":
    main()
