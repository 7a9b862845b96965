"""Interface of the field scorer to ocisac_fast, the only file with its names: ``score.py --adapter FILE``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

import ocisac_fast
from ocisac_fast.packets import PacketFormat


@dataclass
class Reading:
    """Chips of one light in one frame.

    Attributes:
        bits: '0' and '1', one per chip.
        phase: row at which the first of them begins, half an exposure after the light's edge.
        rows_per_chip: rows.
        soft: one per bit, its magnitude is the reliability.
        flags: 0: none.
        source: number of the light, 0 the strongest.
        exposure: s, given or estimated; packets only.
        error_rate: expected error rate; packets only.
        payload: bytes, if one was completed by this frame; packets only.
    """

    bits: str
    phase: float
    rows_per_chip: float = np.nan
    soft: np.ndarray = field(default_factory=lambda: np.zeros(0))
    flags: int = 0
    source: int = 0
    exposure: float = np.nan
    error_rate: float = np.nan
    payload: bytes | None = None


def transmit(payload: bytes, line_code: str, block_bytes: int) -> np.ndarray:
    """The payload's cycle of chips, 0 and 1."""
    return np.asarray(
        ocisac_fast.transmit(payload, format=PacketFormat(line_code=line_code, block_bytes=block_bytes)).chips, np.uint8
    )


def camera(row_time: float, exposure: float | None, frame_time: float, tone_curve: str, dark_level: float):
    """A camera; times in s, dark level in DN."""
    return ocisac_fast.Camera(
        row_time=row_time, exposure=exposure, frame_time=frame_time, tone_curve=tone_curve, dark_level=dark_level
    )


def receive(pixels: np.ndarray, of_camera) -> list[Reading]:
    """Blind reception of one picture, (rows, columns) or (rows, columns, colours)."""
    return [
        Reading(r.bits, r.phase, r.rows_per_chip, np.asarray(r.relative_levels), int(r.flags), r.source)
        for r in ocisac_fast.receive(pixels[None], of_camera)
    ]


def receiver(
    of_camera, several: bool, region: tuple | None, chip_rate: float, line_code: str, block_bytes: int
) -> Callable[[np.ndarray, int | None], list[Reading]]:
    """A receiver of packets: a function of the next picture (and its number) that returns its readings."""
    options = {"chip_rate": chip_rate, "format": PacketFormat(line_code=line_code, block_bytes=block_bytes)}
    if several:
        many = ocisac_fast.MultiReceiver(of_camera, regions=[tuple(region)] if region else (), **options)
        return lambda pixels, number: [_packets(s.received) for s in many.push(pixels, number=number)]
    one = ocisac_fast.Receiver(of_camera, **options)
    return lambda pixels, number: [_packets(one.push(pixels, number=number))]


def _packets(frame) -> Reading:
    payload = None if frame.payload is None else frame.payload.data
    return Reading(frame.bits, frame.phase, exposure=frame.exposure, error_rate=frame.error_rate, payload=payload)


def square_gain(pixels: np.ndarray, of_camera, frequency: float, background: float):
    """Gain of a square wave in each column, its standard error, flags."""
    gain = ocisac_fast.tone_gain(
        pixels, of_camera, frequency, method="robust", waveform="square", background=background
    )
    return gain.gain, gain.gain_std, gain.flags
