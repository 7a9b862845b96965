"""Files of ``ocisac transmit --fsk``: the sequence of tones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ocisac_fast.cli.sent_files import c_header_bytes, csv_bytes, npy_bytes
from ocisac_fast.packets.fsk import FskTransmission


def symbols_text(sent: FskTransmission, _: float | None = None) -> bytes:
    """Indices of the tones, from 0."""
    return " ".join(map(str, sent.symbols.tolist())).encode() + b"\n"


def _npy(sent: FskTransmission, _: float | None) -> bytes:
    return npy_bytes(sent.symbols)


def _csv(sent: FskTransmission, frame_rate: float | None) -> bytes:
    return csv_bytes("symbol", "tone_hz", [sent.tones[symbol] for symbol in sent.symbols.tolist()], frame_rate)


def _c_header(sent: FskTransmission, frame_rate: float | None) -> bytes:
    symbols = list(map(str, sent.symbols.tolist()))
    comment = [
        f"A packet of {len(sent.payload)} bytes: send a tone for each symbol, one after the other, over and over.",
        "Symbol k: ocisac_tones_hz[ocisac_symbols[k]].",
    ]
    definitions = [
        *([] if frame_rate is None else [f"#define OCISAC_SYMBOL_RATE_HZ {frame_rate!r}"]),
        f"#define OCISAC_SYMBOL_COUNT {len(symbols)}UL",
        f"static const double ocisac_tones_hz[{len(sent.tones)}] = {{{', '.join(map(repr, sent.tones))}}};",
    ]
    return c_header_bytes("symbols", symbols, comment, definitions)


SYMBOL_WRITERS: dict[str, Callable[[Any, float | None], bytes]] = {
    ".txt": symbols_text,
    ".npy": _npy,
    ".csv": _csv,
    ".h": _c_header,
}
