"""CM-FSK: one tone out of a set per frame, for lights and cameras unsuited to chips."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import Invertible, Within, checked
from ocisac_fast.core.results import Result
from ocisac_fast.light.waveforms import Chips, Product, Sum, Tone, Waveform
from ocisac_fast.packets.transmission import PacketFormat, transmit


@dataclass(frozen=True, repr=False, eq=False)
class FskTransmission(Result):
    """A packet as tones, one per symbol time, repeated.

    Attributes:
        symbols: (symbols,) uint8, index of the tone, read-only; each holds log2(tones) bits of the packet, the most
            significant first.
        tones: Hz.
        payload: its bytes.
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

    @checked
    def waveform(self, symbol_time: Invertible, *, start: float = 0.0, amplitude: float = 1.0) -> Waveform:
        """The light for all time: amplitude * (1 + cos(2 pi f t)) / 2 with the next f every ``symbol_time`` (s).

        Symbol 0 begins at ``start`` (s).
        """
        gates = [
            Product(
                [
                    Chips(self.symbols == symbol, 1.0 / symbol_time, start=start, repeat=True, amplitude=amplitude),
                    Tone(tone),
                ]
            )
            for symbol, tone in enumerate(self.tones)
            if (self.symbols == symbol).any()
        ]
        return Sum(gates)


@dataclass(frozen=True, slots=True, repr=False)
class FskSymbol(Result):
    """Detected tone of a frame.

    Attributes:
        symbol: index of the most likely tone.
        log_likelihoods: (tones,) ln p(rows | tone), maximum 0.
        llr: (bits,) ln P(1)/P(0) of the symbol's bits, nats, the most significant first.
        snr: symbol energy over the density of noise and of other light at the tone, a plain ratio.
        error_rate: theoretical symbol error rate at that ratio.
        amplitude: of the tone in the rows, in their unit.
        noise: standard deviation of a row.
    """

    symbol: int
    log_likelihoods: Float64s
    llr: Float64s
    snr: float
    error_rate: float
    amplitude: float
    noise: float


@checked
def fsk_transmit(
    payload: bytes | npt.ArrayLike,
    tones: Sequence[float],
    *,
    block_bytes: int = 4,
    preamble: str = "standard",
    number: int = 0,
) -> FskTransmission:
    """Encode a payload as tones: the chips of :func:`transmit` with line code "none", log2(tones) of them per symbol.

    One symbol lasts one frame of the receiver, so the data rate is log2(tones) bits per frame.

    Args:
        payload, preamble, number: as in :func:`transmit`.
        tones: Hz; 2, 4, 8, ... 256 of them, all different. Orthogonal if spaced by multiples of
            1 / (rows * row_time); away from the nulls of the exposure, f = k / exposure.
        block_bytes: coded bytes of a block; shorter blocks repeat the header more often.
    """
    frequencies = fsk_tones(tones)
    format = PacketFormat(line_code="none", block_bytes=block_bytes, preamble=preamble)
    sent = transmit(payload, format=format, number=number)
    bits = int(math.log2(len(frequencies)))
    cycle = np.tile(sent.chips, bits // math.gcd(len(sent.chips), bits))
    symbols = (cycle.reshape(-1, bits) @ (1 << np.arange(bits)[::-1])).astype(np.uint8)
    symbols.flags.writeable = False
    return FskTransmission(symbols, frequencies, sent.payload, number, block_bytes, preamble)


@checked
def fsk_demodulate(
    column: npt.ArrayLike,
    camera: Camera,
    tones: Sequence[float],
    *,
    amplitude: Annotated[float, Within(0.0, 1e100)] | None = None,
) -> FskSymbol:
    """Detect the tone of a column noncoherently; mean and slope along the column are unknown.

    With r_m the length of the projection on tone m and e_m the one expected,
    ln p(rows | m) = ln I0(e_m r_m / noise^2) - e_m^2 / (2 noise^2) + const,
    e_m = amplitude |sinc(f_m T_e)| sqrt(rows / 2).

    noise^2 is the variance that the strongest tone leaves, or the power that a PWM lamp or a texture is expected to
    have there, if that is more: what is left from a third of the tone's frequency on, falling with the frequency's
    square.

    Args:
        column: (rows,) linear light.
        camera: row time; exposure where known.
        tones: Hz, as in :func:`fsk_transmit`, below half the row rate, at least one cycle in the column.
        amplitude: of the light's tone before the exposure, in the unit of the rows; None: estimated.
    """
    rows = np.asarray(column)
    if rows.ndim != 1 or rows.dtype.kind not in "buif":
        raise ValueError(f"column: got shape {rows.shape} of {rows.dtype}, allowed: (rows,) of real numbers")
    largest = float(np.abs(rows).max(initial=0.0))
    if not largest <= 1e100:
        raise ValueError(f"column: got {largest}, allowed: finite numbers of at most 1e100")
    signal = rows.astype(np.float64).tolist()
    return FskSymbol(*_core.fsk_demodulate(camera._handle, list(fsk_tones(tones)), signal, amplitude))


@checked
def fsk_symbol_error_rate(tones: int, snr: float) -> float:
    """Symbol error rate of noncoherent detection of one of M orthogonal tones at E_s/N_0 = ``snr``:

    sum over k = 1 ... M - 1 of (-1)^(k+1) C(M - 1, k) / (k + 1) exp(-k / (k + 1) snr). Raises ValueError for fewer than
    two tones and a ratio below 0.
    """
    return _core.fsk_symbol_error_rate(tones, snr)


def fsk_tones(tones: Sequence[float]) -> tuple[float, ...]:
    frequencies = tuple(float(tone) for tone in tones)
    count = len(frequencies)
    if count not in (2, 4, 8, 16, 32, 64, 128, 256):
        raise ValueError(f"tones: got {count} tones, allowed: 2, 4, 8, … 256 tones")
    for tone in frequencies:
        if not (math.isfinite(tone) and tone > 0.0) or frequencies.count(tone) > 1:
            raise ValueError(f"tones: got {tone}, allowed: finite frequencies above 0, each once")
    return frequencies
