"""Write the demo recording of the page: a lamp that sends a packet and, beside it, one of 900 Hz, 10 frames.

usage: make_demo.py FOLDER
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from ocisac_fast import Camera, Chips, Tone, integrate_exposure
from ocisac_fast.packets import PacketFormat, transmit

ROWS, COLUMNS, FRAMES = 720, 64, 10
ROW_TIME, EXPOSURE, FRAME_TIME = 22.2e-6, 100e-6, 1 / 30
CHIP_RATE, BLOCK_BYTES = 15e3, 8
TEXT = "Hello from a lamp"


def main(folder: Path) -> None:
    camera = Camera(ROW_TIME, EXPOSURE, FRAME_TIME)
    chips = transmit(TEXT.encode(), format=PacketFormat(block_bytes=BLOCK_BYTES)).chips
    data = Chips(chips, CHIP_RATE, repeat=True)
    random = np.random.default_rng(0)
    x = np.arange(COLUMNS)
    left, right = (np.exp(-0.5 * ((x - centre) / 6.0) ** 2) for centre in (16, 48))
    frames = []
    for number in range(FRAMES):
        start = number * FRAME_TIME
        packet, tone = (integrate_exposure(light, camera, ROWS, start=start) for light in (data, Tone(900.0)))
        light = 12.0 + 190.0 * (np.outer(packet, left) + np.outer(tone, right))
        frames.append(np.clip(np.rint(light + random.normal(scale=1.0, size=light.shape)), 0, 255).astype(np.uint8))
    np.save(folder / "demo.npy", np.array(frames))
    # Fields of the page's form: times in us.
    told = {"rowTime": 22.2, "known": "", "exposure": 100, "chipRate": 15000, "blockBytes": BLOCK_BYTES}
    told |= {"lineCode": "manchester", "scanAxis": "down", "toneCurve": "linear", "sense": ""}
    (folder / "demo.json").write_text(json.dumps(told) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
