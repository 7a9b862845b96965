#!/usr/bin/env python3
"""From noisy rows to payloads: frames, goodput through the gap between frames, processor time of a frame.

1 kB in Manchester code, 8 kchip/s, exposure 622 us (5 chips), 1080 rows of 22.2 us at 30 frame/s, 4 % noise, a
gradient; the frame clock locked to the chip clock or drifting; a rate error up to 1 %, the exposure given or not.
--check: at most 130 frames.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Iterator

import numpy as np

from ocisac_fast import Camera, Receiver, integrate_exposure, transmit
from ocisac_fast.packets.goodput import possible_goodput

ROW_TIME, FRAME_TIME, ROWS, CHIP_RATE = 22.2e-6, 1 / 30, 1080, 8e3
CAMERA = Camera(ROW_TIME, 622e-6, frame_time=FRAME_TIME)
MAX_FRAMES = 130


def frames_of(payload: bytes, seed: int, drift: float) -> Iterator[np.ndarray]:
    """Rows of frames of a light that repeats a packet, with a gradient and noise; ``drift``: of the frame clock."""
    random = np.random.default_rng(seed)
    waveform = transmit(payload).waveform(CHIP_RATE)
    begin = random.uniform(0.0, 8.0)
    for index in range(2 * MAX_FRAMES):
        light = integrate_exposure(waveform, CAMERA, ROWS, start=begin + index * FRAME_TIME * (1.0 + drift))
        yield 20.0 + 100.0 * np.linspace(1.0, 0.6, ROWS) * (light + 0.04 * random.standard_normal(ROWS))


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
    known = CAMERA if exposure_given else Camera(ROW_TIME, None, frame_time=FRAME_TIME)
    receiver = Receiver(known, chip_rate=CHIP_RATE * (1.0 + rate_error))
    times, frames = [], None
    for index, rows in enumerate(frames_of(payload, seed, drift)):
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


def print_links(results: list[Result]) -> None:
    bound = possible_goodput(1000, CAMERA, chip_rate=CHIP_RATE, rows=ROWS)
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
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    results = links(options.starts)
    if options.json:
        print(json.dumps({"links": [dataclasses.asdict(r) for r in results]}))
    else:
        print_links(results)
    good = all(r.frames is not None and r.frames <= MAX_FRAMES for r in results)
    return 0 if good or not options.check else 1


if __name__ == "__main__":
    sys.exit(main())
