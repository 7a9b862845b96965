"""A camera for the stand-ins: raw frames of a lamp that sends "Hello, world" at 12 kHz in blocks of 4 bytes."""

from __future__ import annotations

import sys

import numpy as np

from ocisac_fast import Camera, Chips, transmit
from ocisac_fast.packets import PacketFormat
from ocisac_fast.scene.simulation import simulate_frames

FRAMES, LAMP_COLUMNS = 25, 32


def send(width: int, height: int, row_time: float, exposure: float, pixels: str) -> None:
    """Write frames as ``gray8``, ``yuv420p`` or ``yuyv``."""
    light = Chips(
        "".join(map(str, transmit(b"Hello, world", format=PacketFormat(block_bytes=4)).chips.tolist())),
        12e3,
        repeat=True,
    )
    camera = Camera(row_time, exposure, frame_time=1 / 30)
    columns = simulate_frames(light, camera, height, LAMP_COLUMNS, FRAMES, swing=150.0, dark_level=20.0, noise=2.0)
    picture = np.full((height, width), 20, np.uint8)
    left = (width - LAMP_COLUMNS) // 2
    for lamp in columns:
        picture[:, left : left + LAMP_COLUMNS] = lamp
        frame = np.stack([picture, np.full_like(picture, 128)], axis=-1) if pixels == "yuyv" else picture
        sys.stdout.buffer.write(frame.tobytes())
        if pixels == "yuv420p":
            sys.stdout.buffer.write(bytes([128]) * (width * height // 2))
