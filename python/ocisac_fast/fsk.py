"""CM-FSK: one tone out of a set for each frame, for lights and cameras that chips do not suit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera import Camera
from ocisac_fast.flags import Flag
from ocisac_fast.stream_receiver import _frame_channels, _frame_number
from ocisac_fast.transmission import Payload, Stretch, _count, transmit
from ocisac_fast.waveforms import Chips, Product, Sum, Tone, Waveform

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FskTransmission:
    """A packet as tones, one a symbol time, over and over.

    Attributes:
        symbols: (symbols,) uint8, index of the tone, read-only: log2(tones) bits of the packet each, the first one
            most significant.
        tones: Hz.
        payload: the bytes in it.
        number: of the packet.
        block_bytes: coded bytes of a block.
        preamble: "standard" or "lengthened".
    """

    symbols: npt.NDArray[np.uint8]
    tones: tuple[float, ...]
    payload: bytes
    number: int
    block_bytes: int
    preamble: str

    def waveform(self, symbol_time: float, *, start: float = 0.0, amplitude: float = 1.0) -> Waveform:
        """The light, for all time: amplitude * (1 + cos(2 pi f t)) / 2 with another f each ``symbol_time`` (s).

        Symbol 0 begins at ``start`` (s).
        """
        gates = [
            Product([Chips(self.symbols == symbol, 1.0 / symbol_time, start, True, amplitude), Tone(tone)])
            for symbol, tone in enumerate(self.tones)
            if (self.symbols == symbol).any()
        ]
        return Sum(gates)


@dataclass(frozen=True, slots=True)
class FskSymbol:
    """Which of the tones a frame shows.

    Attributes:
        symbol: index of the likeliest tone.
        likelihoods: (tones,) ln p(rows | tone), the likeliest at 0.
        llr: (bits,) ln P(1)/P(0) of the symbol's bits, nats, the most significant first.
        snr: symbol energy over noise density, a plain ratio.
        error_rate: of symbols, by theory at that ratio.
        amplitude: of the tone in the rows, in their unit.
        noise: standard deviation of a row.
    """

    symbol: int
    likelihoods: FloatArray
    llr: FloatArray
    snr: float
    error_rate: float
    amplitude: float
    noise: float


@dataclass(frozen=True, slots=True)
class FskFrame:
    """What a frame gave.

    Attributes:
        frame: its number.
        outcome: "received"; or "no_signal", "not_finite", "repeated", "other_shape", as of ``ReceivedFrame``.
        missing: frames between the last one and this, by their numbers.
        channel: index of the colour channel that was read.
        symbol: what was seen; None where nothing was looked at.
        stretch: what the packet took of it; None where nothing was received.
        flags: :class:`ocisac_fast.Flag`.
    """

    frame: int
    outcome: str
    missing: int
    channel: int
    symbol: FskSymbol | None
    stretch: Stretch | None
    flags: Flag

    @property
    def payload(self) -> Payload | None:
        """The payload that this frame made whole."""
        return None if self.stretch is None else self.stretch.payload


def fsk_transmit(
    payload: bytes | npt.ArrayLike,
    tones: Sequence[float],
    *,
    block_bytes: int = 4,
    preamble: str = "standard",
    number: int = 0,
) -> FskTransmission:
    """A payload as tones: the chips of :func:`transmit` with line code "none", log2(tones) of them a symbol.

    One symbol lasts one frame of the receiver, so that the payload comes at log2(tones) bits a frame.

    Args:
        payload, preamble, number: as of :func:`transmit`.
        tones: Hz; 2, 4, 8, ... 256 of them, all different. Orthogonal where they lie apart by multiples of
            1 / (rows * row_time); away from the nulls of the exposure, f = k / exposure.
        block_bytes: coded bytes of a block; short ones show a header soon.

    Raises:
        ValueError: an argument outside its range; the message names it.
    """
    frequencies = _tones(tones)
    sent = transmit(payload, line_code="none", block_bytes=block_bytes, preamble=preamble, number=number)
    bits = int(math.log2(len(frequencies)))
    cycle = np.tile(sent.chips, bits // math.gcd(len(sent.chips), bits))
    symbols = (cycle.reshape(-1, bits) @ (1 << np.arange(bits)[::-1])).astype(np.uint8)
    symbols.flags.writeable = False
    return FskTransmission(symbols, frequencies, sent.payload, number, block_bytes, preamble)


def fsk_demodulate(
    column: npt.ArrayLike, camera: Camera, tones: Sequence[float], *, amplitude: float | None = None
) -> FskSymbol:
    """Which tone a column shows: noncoherent detection, mean and slope along the column unknown.

    With r_m the length of the projection on tone m and e_m the one expected,
    ln p(rows | m) = ln I0(e_m r_m / noise^2) - e_m^2 / (2 noise^2) + const,
    e_m = amplitude |sinc(f_m T_e)| sqrt(rows / 2).

    Args:
        column: (rows,) linear light.
        camera: row time; exposure where known.
        tones: Hz, as of :func:`fsk_transmit`, below half the row rate, at least one cycle in the column.
        amplitude: of the light's tone before the exposure, in the unit of the rows; None: by the strongest tone.

    Raises:
        ValueError: a wrong shape, values that are not finite, tones out of range.
    """
    rows = np.asarray(column)
    if rows.ndim != 1 or rows.dtype.kind not in "buif":
        raise ValueError(f"column: got shape {rows.shape} of {rows.dtype}, allowed: (rows,) of real numbers")
    given = None if amplitude is None else float(amplitude)
    if given is not None and not (math.isfinite(given) and given >= 0.0):
        raise ValueError(f"amplitude: got {given}, allowed: a finite number, 0 or above")
    return FskSymbol(*_core.fsk_demodulate(camera._handle, list(_tones(tones)), rows.astype(np.float64), given))


def fsk_symbol_error_rate(tones: int, snr: float) -> float:
    """Probability that noncoherent detection takes one of M orthogonal tones for another at E_s/N_0 = ``snr``.

    sum over k = 1 ... M - 1 of (-1)^(k+1) C(M - 1, k) / (k + 1) exp(-k / (k + 1) snr). Raises ValueError for fewer than
    two tones and a ratio below 0.
    """
    return _core.fsk_symbol_error_rate(int(tones), float(snr))


class FskReceiver:
    """Packets of :func:`fsk_transmit` out of frames in time order, one symbol a frame; bounded memory.

    Args:
        camera: row time; exposure where known, which must leave 5 % or more of every tone (|sinc(f T_e)|).
        tones: as the sender's, like ``block_bytes`` and ``preamble``.
        block_bytes: coded bytes of a block.
        preamble: "standard" or "lengthened".
        channel: index of the colour channel to read. None: the one in which the light stands out most.

    Raises:
        ValueError: an argument outside its range; the message names it.
    """

    __slots__ = ("_channel", "_handle")

    def __init__(
        self,
        camera: Camera,
        tones: Sequence[float],
        *,
        block_bytes: int = 4,
        preamble: str = "standard",
        channel: int | None = None,
    ) -> None:
        self._channel = channel
        size = _count("block_bytes", block_bytes, 1)
        self._handle = _core.FskReceiver(camera._handle, list(_tones(tones)), size, preamble)

    def push(self, frame: npt.ArrayLike, number: int | None = None) -> FskFrame:
        """The next frame; arguments and errors as of :meth:`ocisac_fast.Receiver.push`."""
        values = self._handle.push(_frame_channels(frame, self._channel), _frame_number(number))
        index, outcome, missing, channel, symbol, stretch, flags = values
        return FskFrame(
            frame=index,
            outcome=outcome,
            missing=missing,
            channel=channel if self._channel is None else self._channel,
            symbol=None if symbol is None else FskSymbol(*symbol),
            stretch=None if stretch is None else Stretch._of(stretch),
            flags=Flag(flags),
        )


def _tones(tones: Sequence[float]) -> tuple[float, ...]:
    frequencies = tuple(float(tone) for tone in tones)
    count = len(frequencies)
    if count not in (2, 4, 8, 16, 32, 64, 128, 256):
        raise ValueError(f"tones: got {count} tones, allowed: 2, 4, 8, … 256 tones")
    for tone in frequencies:
        if not (math.isfinite(tone) and tone > 0.0) or frequencies.count(tone) > 1:
            raise ValueError(f"tones: got {tone}, allowed: finite frequencies above 0, each once")
    return frequencies
