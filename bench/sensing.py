#!/usr/bin/env python3
"""Lights found, followed and used as landmarks: every measure with its aim, and whether it is reached.

find: recall, precision and false lights on the scenes of light_scenes.py; time of a 33-megapixel picture. track:
lights that move and cross in a 1080p video. locate: the camera's position.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator

import light_scenes
import numpy as np
from figures import Figure, print_table

from ocisac_fast import SourceTracker, SquareWave, detect_sources, integrate_exposure, locate_camera

CAMERA = light_scenes.CAMERA


def find(quick: bool, chart: str | None) -> Iterator[Figure]:
    lights, boxes = light_scenes.findings(40 if quick else 200)
    asked = [li for li in lights if li["size"] >= 40 and li["cycles"] >= 5 and li["ratio"] >= 2.5]
    if chart:
        recall = light_scenes.shares(lights, "found", light_scenes.LEAST)
        light_scenes.draw(chart, recall, light_scenes.shares(boxes, "true"))
    name = f"recall: 40 rows, 5 cycles, 2.5 times the noise ({len(asked)} of {len(lights)} lights)"
    yield Figure(name, float(np.mean([li["found"] for li in asked])), limit=0.9, at_most=False)
    name = f"precision ({len(boxes)} boxes)"
    yield Figure(name, float(np.mean([box["true"] for box in boxes])), limit=0.98, at_most=False)
    frames = 20 if quick else 200
    for rate, row in light_scenes.false_lights(frames).items():
        # statistical bound: the given rate plus two standard errors of its count
        most = rate + 2 * float(np.sqrt(rate / frames))
        yield Figure(f"false lights a picture, {rate} set, worst ground", max(row.values()), limit=most)
    for code, (found, others) in light_scenes.data_lights(20 if quick else 100).items():
        yield Figure(f"recall: {code}, 16 chips and more, any ground", found)
        yield Figure(f"  other boxes a scene: {code}", others)
    both, others = light_scenes.neighbours(30 if quick else 300)
    yield Figure("both of two lamps side by side", both, limit=0.95, at_most=False)
    yield Figure("other boxes a pair of lamps", others, limit=0.05)
    for name, value in speed().items():
        yield Figure(f"33 megapixels, {name}", value, "ms", 60.0)


def speed() -> dict[str, float]:
    """Milliseconds of a 33-megapixel picture of noise with four lights, the fastest of seven, on one core."""
    random = np.random.default_rng(0)
    picture = np.clip(np.rint(20 + 2 * random.standard_normal((4352, 7712), np.float32)), 0, 255).astype(np.uint8)
    for k, frequency in enumerate((3000.0, 4000.0, 5000.0, 6000.0)):
        light = integrate_exposure(SquareWave(frequency), CAMERA, 4352)
        top, left = 700 * (k + 1), 1500 * (k + 1)
        picture[top : top + 120, left : left + 120] = (20 + 150 * light[top : top + 120, None]).astype(np.uint8)
    result = {}
    for name, frame in (("rows down", picture), ("rows across", np.asfortranarray(picture))):
        times = []
        for _ in range(7):
            start = time.perf_counter()
            found = detect_sources(frame, CAMERA)
            times.append(1e3 * (time.perf_counter() - start))
        if len(found) != 4:
            raise SystemExit(f"sensing.py: {name}: {len(found)} lights of 4; not timed")
        result[name] = min(times)
    return result


# Frequency, row and column, their steps a frame, radius.
LAMPS = ((3000.0, 300, 300, 3, 8, 60), (4500.0, 420, 900, 0, -8, 50), (6100.0, 800, 900, -2, 4, 40))


def video(frames: int) -> list[np.ndarray]:
    """1080p, three moving lights of 80 to 120 rows, two of which cross."""
    random = np.random.default_rng(0)
    still = np.clip(np.rint(25 + 2 * random.standard_normal((1080, 1920))), 0, 255).astype(np.uint8)
    pictures = []
    for k in range(frames):
        picture = still.copy()
        for frequency, row, column, down, right, radius in LAMPS:
            top, left = row + down * k - radius, column + right * k - radius
            light = integrate_exposure(SquareWave(frequency), CAMERA, 1080, start=k / 240.0)[
                top : top + 2 * radius, None
            ]
            y, x = np.ogrid[-radius:radius, -radius:radius]
            part = picture[top : top + 2 * radius, left : left + 2 * radius]
            part[:] = np.where(x**2 + y**2 < radius**2, np.rint(20 + 150 * light).astype(np.uint8), part)
        pictures.append(picture)
    return pictures


def track(quick: bool) -> Iterator[Figure]:
    """Detection with gains in a tracker; full search every 30 frames. Minimum of three runs for each frame."""
    pictures = video(30 if quick else 60)
    times = np.full((3, len(pictures)), np.inf)
    for run in range(3):
        tracker = SourceTracker(CAMERA, full_every=30)
        for k, picture in enumerate(pictures):
            start = time.perf_counter()
            tracks = tracker.update(picture)
            times[run, k] = time.perf_counter() - start
    lights = len(LAMPS)
    kept = sum(one.identity < lights and one.visible for one in tracks)
    rate = 1 / float(times.min(axis=0).mean())
    yield Figure(f"of {lights} lights that keep their identity while two cross", kept, limit=lights, at_most=False)
    yield Figure(f"frame/s, 1080p, {lights} lights with their gains", rate, limit=240.0, at_most=False)
    yield Figure("pixels, a box's edge from the lamp's, beyond a full look's", edges_apart(pictures), limit=0.5)


def edges_apart(pictures: list[np.ndarray]) -> float:
    """Mean distance of a tracked light's four edges from its lamp's, less that of a full search of each frame."""
    distances = []
    for every in (30, 1):
        tracker, apart = SourceTracker(CAMERA, full_every=every), []
        for k, picture in enumerate(pictures):
            for one in (track for track in tracker.update(picture) if track.visible):
                _, row, column, down, right, radius = min(LAMPS, key=lambda lamp: abs(lamp[0] - one.frequency))
                x, y, box = column + right * k, row + down * k, one.source
                apart += [box.x - x + radius, box.x + box.width - x - radius]
                apart += [box.y - y + radius, box.y + box.height - y - radius]
        distances.append(float(np.mean(np.abs(apart))))
    return distances[0] - distances[1]


def locating(cases: int) -> float:
    """Largest error of the camera's position, m: six lights at 3 m, focal length 1500 pixels, noise 1 pixel."""
    lamps = np.array(
        [[-1.3, -0.7, 3.0], [1.3, -0.7, 3.0], [1.3, 0.7, 3.0], [-1.3, 0.7, 3.0], [0.1, 0.0, 2.7], [-0.5, 0.3, 2.6]]
    )
    random, worst = np.random.default_rng(5), 0.0
    for _ in range(cases):
        place = random.uniform(-0.3, 0.3, 3) * (1, 1, 0.3)
        inside = lamps - place
        pixels = 1500.0 * inside[:, :2] / inside[:, 2:] + (960.0, 540.0) + random.normal(0, 1, (len(lamps), 2))
        worst = max(
            worst,
            float(np.linalg.norm(locate_camera(lamps, pixels, focal=1500.0, centre=(960.0, 540.0)).position - place)),
        )
    return worst


def parts(options: argparse.Namespace) -> Iterator[tuple[str, list[Figure]]]:
    """The parts asked for."""
    if options.only in (None, "find"):
        yield "find", list(find(options.quick, options.chart))
    if options.only in (None, "track"):
        yield "track", list(track(options.quick))
    if options.only in (None, "locate"):
        yield "locate", [Figure("largest error at 3 m, m", locating(30 if options.quick else 300), limit=0.05)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--chart", help="picture of recall and precision")
    parser.add_argument("--check", action="store_true", help="fail if an aim is not reached")
    parser.add_argument("--quick", action="store_true", help="fewer scenes")
    parser.add_argument("--only", choices=("find", "track", "locate"))
    options = parser.parse_args()
    measures = []
    for part, figures in parts(options):
        measures += [{"part": part, **one.record()} for one in figures]
        if not options.json:
            print_table(figures)
    if options.json:
        print(json.dumps({"measures": measures}))
    lacking = [f"{one['part']}: {one['name']}" for one in measures if one["reached"] is False]
    if options.check and lacking:
        sys.exit(f"sensing.py: not reached: {'; '.join(lacking)}")


if __name__ == "__main__":
    main()
