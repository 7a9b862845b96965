#!/usr/bin/env python3
"""From noisy rows and pixels to payloads: frames and goodput through the gap between frames, and speed.

Frames: 1 kB in Manchester code, 8 kchip/s, exposure 622 us (5 chips), 1080 rows of 22.2 us at 30 frame/s, 4 % noise, a
gradient; the frame clock locked to the chip clock or drifting; a rate error up to 1 %, the exposure given or not.
Speed: processor time of one thread from pixels (1080 x 1920 bytes) and from combined columns (7 chips of exposure, 4
rows per chip, 2 % noise) to payloads, the minimum over batches of frames; other load can only increase it. --check: at
most 130 frames, 120 frame/s from pixels and 1000 frame/s from columns.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time

import numpy as np

import ocisac_fast as ocisac
from ocisac_fast import Camera
from ocisac_fast.packets.goodput import possible_goodput
from ocisac_fast.receiver.stream import Receiver

ROW_TIME, FRAME_TIME, ROWS, CHIP_RATE = 22.2e-6, 1 / 30, 1080, 8e3
EXPOSURE = 622e-6
MAX_FRAMES, PIXEL_SPEED, COLUMN_SPEED = 130, 120.0, 1000.0
BATCH = 10  # frames per timing


class Light:
    """A packet's light as rows of frames: gradient, noise (share of the swing), drifting clock."""

    def __init__(self, payload: bytes, seed: int, camera: Camera, chip_rate: float, noise: float, drift: float) -> None:
        self.random = np.random.default_rng(seed)
        self.waveform = ocisac.transmit(payload).waveform(chip_rate)
        self.camera, self.noise, self.drift = camera, noise, drift
        self.start = self.random.uniform(0.0, 8.0)

    def frame(self, index: int) -> np.ndarray:
        assert self.camera.frame_time is not None
        start = self.start + index * self.camera.frame_time * (1.0 + self.drift)
        light = ocisac.integrate_exposure(self.waveform, self.camera, ROWS, start=start)
        return 20.0 + 100.0 * np.linspace(1.0, 0.6, ROWS) * (light + self.noise * self.random.standard_normal(ROWS))


@dataclasses.dataclass(frozen=True)
class Result:
    """One start. frames: until the payload was complete, or None. first_ms: time of the first frame."""

    drift: float
    rate_error: float
    exposure_given: bool
    frames: int | None
    goodput: float
    first_ms: float
    frame_ms: float


def run(payload: bytes, seed: int, drift: float, rate_error: float, exposure_given: bool) -> Result:
    camera = Camera(ROW_TIME, EXPOSURE, frame_time=FRAME_TIME)
    light = Light(payload, seed, camera, CHIP_RATE, 0.04, drift)
    known = camera if exposure_given else Camera(ROW_TIME, None, frame_time=FRAME_TIME)
    receiver = Receiver(known, chip_rate=CHIP_RATE * (1.0 + rate_error))
    times, frames = [], None
    for index in range(2 * MAX_FRAMES):
        rows = light.frame(index)
        begin = time.process_time()
        result = receiver.push(rows)
        times.append(time.process_time() - begin)
        if result.payload is not None:
            assert result.payload.data == payload
            frames = index + 1
            break
    goodput = 0.0 if frames is None else 8.0 * len(payload) / (frames * FRAME_TIME)
    return Result(drift, rate_error, exposure_given, frames, goodput, 1e3 * times[0], 1e3 * float(np.median(times)))


def links(starts: int) -> list[Result]:
    payload = np.random.default_rng(11).bytes(1000)
    results = []
    for start in range(starts):
        for drift, given in ((0.0, True), (5e-5, True), (-5e-5, True), (0.0, False)):
            rate_error = (0.0, 0.01, -0.01)[(start + (drift > 0)) % 3]
            results.append(run(payload, start, drift, rate_error, given))
    return results


def fastest(receiver: Receiver, frames: list[np.ndarray]) -> tuple[float, int]:
    """Frames per second of processor time, best batch after the first; and the number of payloads."""
    seconds, payloads = [], 0
    for first in range(0, len(frames) - BATCH + 1, BATCH):
        begin = time.process_time()
        for frame in frames[first : first + BATCH]:
            payloads += receiver.push(frame).payload is not None
        seconds.append(time.process_time() - begin)
    return BATCH / min(seconds[1:]), payloads


def pixel_speed() -> tuple[float, int]:
    camera = Camera(ROW_TIME, EXPOSURE, frame_time=FRAME_TIME)
    light = Light(b"sixty bytes of a payload, from pixels".ljust(60), 1, camera, CHIP_RATE, 0.0, 0.0)
    across = np.exp(-(np.linspace(-2.0, 1.5, 1920) ** 2))
    noise = 3.0 * np.random.default_rng(1).standard_normal((ROWS, 1920))
    frames = [
        np.clip(np.rint(light.frame(k)[:, np.newaxis] * across + np.roll(noise, 31 * k)), 0, 255).astype(np.uint8)
        for k in range(4 * BATCH)
    ]
    return fastest(Receiver(camera, chip_rate=CHIP_RATE * 1.002), frames)


def column_speed() -> tuple[float, int]:
    rate = 1.0 / (4.0 * ROW_TIME)
    camera = Camera(ROW_TIME, 7.0 / rate, frame_time=FRAME_TIME)
    light = Light(b"sixty bytes of a payload, from rows".ljust(60), 1, camera, rate, 0.02, 0.0)
    frames = [light.frame(k) for k in range(10 * BATCH)]
    return fastest(Receiver(camera, chip_rate=rate * 1.002), frames)


def print_links(results: list[Result]) -> None:
    camera = Camera(ROW_TIME, EXPOSURE, frame_time=FRAME_TIME)
    bound = possible_goodput(1000, camera, chip_rate=CHIP_RATE, rows=ROWS)
    print("drift  rate off  exposure  frames  goodput bit/s  first frame ms  frame ms")
    for r in results:
        given = "given" if r.exposure_given else "found"
        print(
            f"{1e6 * r.drift:4.0f} ppm  {100 * r.rate_error:5.1f} %  {given:>8}  {r.frames or '-':>6}"
            f"  {r.goodput:13.0f}  {r.first_ms:14.0f}  {r.frame_ms:8.2f}"
        )
    print(f"possible: {bound.gap:.0f} bit/s through the gap ({bound.gap_frames:.1f} frames), ", end="")
    print(f"{bound.code:.0f} bit/s of these packets ({bound.code_frames:.1f} frames)")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=3)
    parser.add_argument("--no-speed", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    results = links(options.starts)
    speeds = {} if options.no_speed else {"pixels": pixel_speed(), "columns": column_speed()}
    if options.json:
        speed = {name: {"frames_per_second": value, "payloads": count} for name, (value, count) in speeds.items()}
        print(json.dumps({"links": [dataclasses.asdict(r) for r in results], "speed": speed}))
    else:
        print_links(results)
        for name, (value, count) in speeds.items():
            print(f"from {name}: {value:.0f} frame/s ({count} payloads)")
    good = all(r.frames is not None and r.frames <= MAX_FRAMES for r in results)
    for name, aim in (("pixels", PIXEL_SPEED), ("columns", COLUMN_SPEED)):
        good = good and (name not in speeds or (speeds[name][0] >= aim and speeds[name][1] > 0))
    return 0 if good or not options.check else 1


if __name__ == "__main__":
    sys.exit(main())
