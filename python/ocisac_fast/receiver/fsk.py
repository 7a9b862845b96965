"""Receiver of CM-FSK packets from frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.checks import checked, checked_class, count
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.results import Result
from ocisac_fast.packets.fsk import FskSymbol, fsk_tones
from ocisac_fast.packets.transmission import Payload, Stretch
from ocisac_fast.receiver.stream import frame_colours, frame_values


@dataclass(frozen=True, slots=True, repr=False)
class FskFrame(Result):
    """Result of a frame.

    Attributes:
        frame: its number.
        outcome: "received"; or "no_signal", "not_finite", "repeated", "other_shape", as in ``ReceivedFrame``.
        missing: number of frames missing since the last one.
        colour: index of the colour used.
        symbol: the detected symbol; None if the frame was not evaluated.
        stretch: result of the packet's decoding; None if nothing was received.
        flags: :class:`ocisac_fast.Flag`.
    """

    frame: int
    outcome: str
    missing: int
    colour: int
    symbol: FskSymbol | None
    stretch: Stretch | None
    flags: Flag

    @property
    def payload(self) -> Payload | None:
        """The payload completed by this frame, or None."""
        return None if self.stretch is None else self.stretch.payload


@checked_class
class FskReceiver:
    """Receive packets of :func:`ocisac_fast.packets.fsk_transmit` from frames in time order, one symbol per frame.

    Memory is bounded.

    Args:
        camera: row time; exposure where known, which must keep 5 % or more of every tone (|sinc(f T_e)|).
        tones: of the sender, like ``block_bytes`` and ``preamble``.
        block_bytes: coded bytes of a block.
        preamble: "standard" or "lengthened".
        colour: index of the colour to use. None: the one with the strongest light.
    """

    __slots__ = ("_camera", "_colour", "_handle")

    def __init__(
        self,
        camera: Camera,
        tones: Sequence[float],
        *,
        block_bytes: int = 4,
        preamble: str = "standard",
        colour: int | None = None,
    ) -> None:
        self._camera = camera
        self._colour = colour
        size = count("block_bytes", block_bytes, 1)
        self._handle = _core.FskReceiver(camera._handle, list(fsk_tones(tones)), size, preamble)

    @checked
    def push(self, frame: npt.ArrayLike, *, number: int | None = None) -> FskFrame:
        """Process the next frame; arguments and errors as in :meth:`ocisac_fast.Receiver.push`."""
        values = self._handle.push(frame_colours(frame, self._camera, self._colour), number)
        symbol = None if values["symbol"] is None else FskSymbol(*values["symbol"])
        return FskFrame(**frame_values(values, self._colour) | {"symbol": symbol})
