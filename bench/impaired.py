#!/usr/bin/env python3
"""Processor time of Receiver.push for frames in which something goes wrong, over that of clean frames: a line a kind.

Three draws a kind, of other clocks, levels and noise; the median over the later half of 20 frames, the best of three
runs. In front, the frames until the payload.

usage: bench/impaired.py [--kinds KIND...] [--seed SEED] [--json]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import time

import numpy as np
from calibration import FRAME_TIME, FRAMES, PAYLOAD, ROW_TIME, Draw

from ocisac_fast import Camera, transmit
from ocisac_fast.packets import PacketFormat
from ocisac_fast.receiver.stream import Receiver

KINDS: dict[str, dict[str, float]] = {
    "hum 0.1": {"hum": 0.1},
    "hum 0.5": {"hum": 0.5},
    "PWM lamp 0.2": {"pwm": 0.2},
    "PWM lamp 0.5": {"pwm": 0.5},
    "texture 0.1": {"texture": 0.1},
    "tilt 3 degrees": {"tilt": math.radians(3)},
    "spot of 270 rows": {"spot": 270.0},
    "rise and fall 0.5 chip": {"rise": 0.5, "fall": 0.5},
    "jitter 50 us": {"jitter": 50e-6},
}
RUNS, DRAWS = 3, 3
CLEAN = {"hum": 0.0, "pwm": 0.0, "texture": 0.0, "tilt": 0.0, "spot": math.inf, "rise": 0.0, "fall": 0.0, "jitter": 0.0}


def drawn(seed: int, **impairment: float) -> Draw:
    """A draw of calibration.py with this impairment alone; the camera knows its exposure."""
    draw = Draw.of(seed)
    exposure = min(draw.exposure, 4 / 8e3)
    clean = dataclasses.replace(draw, exposure=exposure, told_exposure=exposure, lamp_width=26.0, **CLEAN)
    return dataclasses.replace(clean, **impairment)


def cost(draw: Draw) -> tuple[float, int | None]:
    """Seconds of processor time a frame, and frames until the payload."""
    sent = transmit(PAYLOAD, format=PacketFormat(block_bytes=8))
    frames = list(draw.frames(sent.chips))
    best, payload = np.full(len(frames), np.inf), None
    for _ in range(RUNS):
        camera = Camera(ROW_TIME, draw.told_exposure, frame_time=FRAME_TIME)
        receiver = Receiver(camera, chip_rate=8e3, format=sent.format)
        for number, pixels in enumerate(frames):
            began = time.process_time()
            result = receiver.push(pixels)
            best[number] = min(best[number], time.process_time() - began)
            if payload is None and result.payload is not None:
                payload = number + 1
    return float(np.median(best[FRAMES // 2 :])), payload


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    seeds = range(options.seed, options.seed + DRAWS)
    clean = {seed: cost(drawn(seed)) for seed in seeds}
    for kind in options.kinds:
        impaired = {seed: cost(drawn(seed, **KINDS[kind])) for seed in seeds}
        ratios = [impaired[seed][0] / clean[seed][0] for seed in seeds]
        payloads = [impaired[seed][1] for seed in seeds]
        if options.json:
            print(json.dumps({"kind": kind, "ratios": ratios, "payload_frames": payloads}), flush=True)
        else:
            print(f"{kind:24s} {' '.join(f'{ratio:6.2f}' for ratio in ratios)}   payload in {payloads}", flush=True)


if __name__ == "__main__":
    main()
