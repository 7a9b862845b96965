"""Payloads as chips of a light, and their recovery from soft chips: line codes and packets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.core.checks import checked, checked_class, count
from ocisac_fast.core.results import Result
from ocisac_fast.light.waveforms import Chips

LINE_CODES = ("none", "manchester", "4b6b", "8b10b")

ByteArray = npt.NDArray[np.uint8]


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True)
class PacketFormat:
    """The parameters that sender and receiver of packets share. See docs/reference/packets.md.

    Args:
        line_code: "none" (NRZ), "manchester", "4b6b", "8b10b", or a table: 2, 4, 16 or 256 words of 0 and 1.
        block_bytes: coded bytes of a block, 1 to 255. Short blocks have more preambles, long ones have less overhead.
        preamble: "standard" (14 chips), or "lengthened" (42) for exposures above 8 chips.
    """

    line_code: str | Sequence[str] = "manchester"
    block_bytes: int = 16
    preamble: str = "standard"

    def __post_init__(self) -> None:
        if not isinstance(self.line_code, str):
            object.__setattr__(self, "line_code", tuple(self.line_code))
        count("block_bytes", self.block_bytes, 1)
        _core.longest_payload(**self._for_core())  # raises ValueError outside of their range

    def _for_core(self) -> dict[str, Any]:
        return {"line_code": self.line_code, "block_bytes": self.block_bytes, "preamble": self.preamble}


@dataclass(frozen=True, repr=False, eq=False)
class Transmission(Result):
    """A packet as the light sends it: one cycle of blocks, repeated. See docs/reference/packets.md.

    Attributes:
        chips: (chips,) uint8, 1 = bright, read-only.
        payload: its bytes.
        number: of the packet.
        format: line code, size of a block, preamble.
        codewords: Reed-Solomon words of 255 bytes.
        codeword_data: bytes of data in each.
        blocks: number of blocks in the cycle.
        block_chips: chips of a block.
    """

    chips: ByteArray
    payload: bytes
    number: int
    format: PacketFormat
    codewords: int
    codeword_data: int
    blocks: int
    block_chips: int

    @checked
    def waveform(self, chip_rate: float, *, start: float = 0.0, amplitude: float = 1.0) -> Chips:
        """The light for all time: repeating ``Chips`` of ``chip_rate`` (Hz), block 0 at ``start`` (s)."""
        return Chips(self.chips, chip_rate, start=start, repeat=True, amplitude=amplitude)


@dataclass(frozen=True, slots=True, repr=False)
class Payload(Result):
    """A complete payload with a correct CRC-32.

    Attributes:
        data: the bytes.
        number: of the packet, 0 to 255.
        corrected: number of corrected coded bytes.
    """

    data: bytes
    number: int
    corrected: int


@dataclass(frozen=True, slots=True, repr=False)
class Stretch(Result):
    """Result of the decoding of a stretch of chips.

    Attributes:
        outcome: "placed": its bytes are in the packet; "waiting": stored until its place and the packet's length are
            known; "repeated": begins before the end of an earlier one, ignored; "unreadable": no chip visible, ignored.
        blocks: preambles with a header.
        bytes: coded bytes received, of the stretches placed now.
        cut: coded bytes that an end of the stretch cuts, of the stretches placed now.
        doubtful: coded bytes with an uncertain bit, of the stretches placed now.
        violations: words that are not in the line code, of the stretches placed now.
        share: received share of the bytes needed, minimum over the codewords; from 1 on decoding is possible.
        payload: the payload if it was completed now.
        inverted: True if the light is dark for 1, as the last header shows.
        lack: what certain chips lack for a payload: "none", or only more of them; "header": five would have been seen
            since the last one (another format, or other light); "place": of the last twelve stretches none has one, or
            the packet's length is not known.
    """

    outcome: str
    blocks: int
    bytes: int
    cut: int
    doubtful: int
    violations: int
    share: float
    payload: Payload | None
    inverted: bool
    lack: str

    @classmethod
    def _of(cls, values: tuple[Any, ...]) -> Stretch:
        """Convert the core's values."""
        *counts, payload, inverted, lack = values
        return cls(*(*counts, None if payload is None else Payload(*payload), inverted, lack))


@checked
def transmit(payload: bytes | npt.ArrayLike, *, format: PacketFormat | None = None, number: int = 0) -> Transmission:
    """Encode a payload as chips of on-off keying that survive the gaps between frames.

    The chips are sent repeatedly; a receiver may begin anywhere. The payload, its number and a CRC-32 fill Reed-Solomon
    words of which about a third is data. They are interleaved over short blocks, each with a preamble and a sequence
    number: any received bytes, as many as the data, recover the payload.

    Args:
        payload: bytes, or (bytes,) uint8; at least 1, at most :func:`longest_payload`.
        format: as the receiver expects it; None: the defaults of :class:`PacketFormat`.
        number: of the packet, 0 to 255; increased by 1 (modulo 256) for each following packet.
    """
    data = _as_bytes(payload)
    format = format or PacketFormat()
    chips, layout = _core.transmit(payload=data, number=count("number", number, 0), **format._for_core())
    chips.flags.writeable = False
    return Transmission(chips, data.tobytes(), number, format, *layout)


@checked
def longest_payload(*, format: PacketFormat | None = None) -> int:
    """Maximum bytes of one packet of ``format`` (None: the defaults); at most 4095."""
    return _core.longest_payload(**(format or PacketFormat())._for_core())


@checked
def encode_line_code(bits: npt.ArrayLike, line_code: str | Sequence[str]) -> ByteArray:
    """Encode bits as chips of a line code, 1 = bright.

    Args:
        bits: (bits,) of 0 and 1, whole words: 1 bit ("none", "manchester"), 4 ("4b6b"), 8 ("8b10b"), or log2 of the
            table's length. The first bit of a word is its most significant one.
        line_code: as in :class:`PacketFormat`. "8b10b" begins at running disparity -1.

    Raises:
        ValueError: values other than 0 and 1, a length that is no whole number of words, an unknown code.
    """
    values = np.asarray(bits)
    if values.ndim != 1 or (values.size and values.dtype.kind not in "bui"):
        raise ValueError(f"bits: got shape {values.shape} of {values.dtype}, allowed: one dimension of 0 and 1")
    if not np.isin(values, (0, 1)).all():
        raise ValueError(f"bits: got {values[~np.isin(values, (0, 1))][0]}, allowed: 0 and 1")
    return _core.encode_line_code(values.astype(np.uint8), line_code)


@checked
def decode_line_code(
    llr: npt.ArrayLike, line_code: str | Sequence[str]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Decode soft chips to soft bits.

    Args:
        llr: (chips,) log-likelihood ratios ln P(bright)/P(dark), nats; 0: unknown. Whole words.
        line_code: as in :class:`PacketFormat`.

    Returns:
        Log-likelihood ratios of the bits, (bits,): the difference between the best words with a 1 and with a 0; and
        violations, (words,): True if the hard decisions of a completely received word are not in the code.

    Raises:
        ValueError: a wrong shape, NaN, a length that is no whole number of words, an unknown code.
    """
    bits, violations = _core.decode_line_code(_as_ratios(llr), line_code)
    return bits, violations.astype(bool)


@checked_class
class PacketAssembler:
    """Assemble payloads from stretches of soft chips at known positions on the sender's clock.

    Memory is bounded. Packets are distinguished by their numbers; a repeated packet is returned each time it is
    completed again.

    Args:
        format: of the sender; None: the defaults of :class:`PacketFormat`.
    """

    __slots__ = ("_handle",)

    def __init__(self, *, format: PacketFormat | None = None) -> None:
        self._handle = _core.PacketAssembler(**(format or PacketFormat())._for_core())

    @checked
    def push(self, first: int, llr: npt.ArrayLike, *, scatter: float = 0.0) -> Stretch:
        """Process the next stretch, in time order.

        Args:
            first: index of its first chip on a clock that counts the chips sent, from any origin. The next header
                corrects a slip by one or two chips.
            llr: (chips,) ln P(bright)/P(dark), nats; 0: unknown.
            scatter: standard error of ``first``, chips, of this stretch alone: frames whose starts jitter. Its place is
                then the most likely one by the expected preamble, header and line code; in doubt it waits.
        """
        return Stretch._of(self._handle.push(first, _as_ratios(llr), scatter))

    def lose_clock(self) -> None:
        """Reset the position after a jump of the clock: received bytes are kept, the next header gives the position."""
        self._handle.lose_clock()


def _as_bytes(payload: bytes | npt.ArrayLike) -> ByteArray:
    if isinstance(payload, (bytes, bytearray, memoryview)):
        return np.frombuffer(payload, np.uint8)
    array = np.asarray(payload)
    if array.ndim != 1 or array.dtype != np.uint8:
        raise ValueError(
            f"payload: got shape {array.shape} of {array.dtype}, allowed: bytes, or one dimension of uint8"
        )
    return np.ascontiguousarray(array)


def _as_ratios(llr: npt.ArrayLike) -> npt.NDArray[np.float64]:
    ratios = np.asarray(llr, np.float64)
    if ratios.ndim != 1:
        raise ValueError(f"llr: got shape {ratios.shape}, allowed: one dimension of real numbers")
    if np.isnan(ratios).any():
        raise ValueError("llr: got NaN, allowed: numbers")
    return np.ascontiguousarray(ratios)
