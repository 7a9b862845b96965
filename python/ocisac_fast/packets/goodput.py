"""Upper bounds of goodput after the gap between frames, line code and packet overhead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.checks import Count, Invertible, checked
from ocisac_fast.core.results import Result
from ocisac_fast.packets.transmission import PacketFormat, encode_line_code, longest_payload, transmit


@dataclass(frozen=True, slots=True, repr=False)
class Goodput(Result):
    """Bits of payload per second at three stages, and the number of frames per payload.

    Attributes:
        sent: of the light's chips through its line code: chip_rate times bits per chip.
        gap: share of these in rows that are read out: sent * rows * row_time / frame_time.
        code: after the overhead of preambles, headers, packet number, CRC-32 and padding, and without the bytes that
            the edges of frames cut: an upper bound for any receiver of these packets.
        gap_frames: frames per payload at the rate ``gap``.
        code_frames: frames per payload at the rate ``code``.
    """

    sent: float
    gap: float
    code: float
    gap_frames: float
    code_frames: float


@checked
def possible_goodput(
    payload_bytes: int,
    camera: Camera,
    *,
    chip_rate: Invertible,
    rows: Count,
    format: PacketFormat | None = None,
) -> Goodput:
    """Upper bounds of the goodput of packets with ``payload_bytes``.

    Args:
        payload_bytes: of a packet, as in :func:`ocisac_fast.transmit`.
        camera: row time and frame time.
        chip_rate: Hz.
        rows: rows of a frame, at least 1, not longer than the frame time.
        format: of the packets; None: the defaults of :class:`PacketFormat`.

    Raises:
        ValueError: an argument outside its range, or a camera without a frame time.
    """
    if camera.frame_time is None:
        raise ValueError("frame_time: got None, allowed: a time in seconds")
    longest = longest_payload(format=format)
    if not 1 <= payload_bytes <= longest:
        raise ValueError(f"payload_bytes: got {payload_bytes}, allowed: 1 to {longest}")
    require_in_frame_time(rows, camera)
    packet = transmit(bytes(payload_bytes), format=format)
    chips_per_byte = encode_line_code(np.zeros(8, np.uint8), packet.format.line_code).size
    sent = 8.0 * chip_rate / chips_per_byte
    gap = sent * rows * camera.row_period / camera.frame_time
    in_blocks = packet.format.block_bytes * chips_per_byte / packet.block_chips
    code = gap * in_blocks * payload_bytes / (packet.codewords * packet.codeword_data)
    frame_bits = 8.0 * payload_bytes / camera.frame_time
    return Goodput(sent, gap, code, frame_bits / gap, frame_bits / code)


def require_in_frame_time(rows: int, camera: Camera) -> None:
    """Raise ValueError for more rows than the camera's frame time holds, if that is known."""
    if camera.frame_time is not None and rows > camera.frame_time / camera.row_period * (1.0 + 1e-9):
        raise ValueError(f"rows: got {rows}, allowed: 1 to as many as the frame time holds")
