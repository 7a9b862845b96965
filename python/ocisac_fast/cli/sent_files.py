"""Files of ``ocisac transmit``, chips or tones: their common parts, and the errors of bits received from them."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.cli.output import emit_facts
from ocisac_fast.cli.outputs import read_input
from ocisac_fast.files.arrays import stream_arrays
from ocisac_fast.files.recording import naming
from ocisac_fast.packets.fsk import FskTransmission
from ocisac_fast.packets.transmission import Transmission


def read_bits(path: str) -> npt.NDArray[np.int64]:
    """The bits of a .txt of ``transmit`` (0 and 1, and white space) or a .npy."""
    if path.lower().endswith(".npy"):
        with naming(path), stream_arrays(io.BytesIO(read_input(path))) as arrays:
            values = np.concatenate([array.ravel() for array in arrays])
    else:
        values = np.frombuffer(b"".join(read_input(path).split()), np.uint8) - np.uint8(ord("0"))
    if values.size == 0 or not np.isin(values, (0, 1)).all():
        raise ValueError(f"--sent: got {path}, allowed: a .txt of 0 and 1, or a .npy of them")
    return values.astype(np.int64)


class ErrorCount:
    """Errors of the bits of frames, each light by itself; none are counted without a file of the sent bits."""

    def __init__(self, path: str | None) -> None:
        self._path = path
        self._sent = None if path is None else read_bits(path)
        self._received: dict[int, list[str]] = {}

    def of(self, facts: dict[str, Any]) -> dict[str, Any]:
        """Errors of a frame's bits, for its JSON object."""
        from ocisac_fast.receiver import compare_bits

        if self._sent is None:
            return {}
        self._received.setdefault(facts.get("source", 0), []).append(facts["bits"])
        found = compare_bits(facts["bits"], self._sent, repeat=True)
        return {name: getattr(found, name) for name in _ERRORS}

    def report(self, as_json: bool) -> None:
        """Print the errors of all frames."""
        from ocisac_fast.receiver import compare_bits

        if as_json or self._sent is None:
            return
        for source, bits in self._received.items():
            found = compare_bits(bits, self._sent, repeat=True)
            facts = {"bit error rate": "unknown: no bits were received"}
            if found.compared:
                facts = {
                    "bit error rate": f"{found.rate:.4g} (95 %: {found.low:.2g} to {found.high:.2g})",
                    "errors": f"{found.errors} of {found.compared} bits",
                    "missing, inserted": f"{found.missing}, {found.inserted}",
                    "inverted": "yes" if found.inverted else "no",
                    "by chance": f"{found.chance:.2g}" + (": unrelated bits align as well" if found.flags else ""),
                }
            emit_facts(f"source {source} against {self._path}", facts)


_ERRORS = ("errors", "compared", "missing", "inserted", "shift", "inverted", "chance")


@dataclasses.dataclass(frozen=True)
class Sent:
    """A transmission as files have it: ``values`` of an ``index``, and for C ``stored`` bytes as ``ocisac_NAME``."""

    text: str
    array: npt.NDArray[Any]
    index: str
    column: str
    values: Sequence[object]
    name: str
    stored: Sequence[object]
    comment: Sequence[str]
    definitions: Sequence[str]

    def file(self, suffix: str, rate: float | None) -> bytes:
        """The bytes of a file of a kind in ``SUFFIXES``; ``rate``: of the values, Hz, if it is known."""
        if suffix == ".npy":
            buffer = io.BytesIO()
            np.save(buffer, self.array)
            return buffer.getvalue()
        lines = {".txt": self._text, ".csv": self._csv, ".h": self._header}[suffix](rate)
        return "\n".join(lines).encode() + b"\n"

    def _text(self, _: float | None) -> list[str]:
        return [self.text]

    def _csv(self, rate: float | None) -> list[str]:
        places = [str(k if rate is None else k / rate) for k in range(len(self.values))]
        rows = [f"{place},{value}" for place, value in zip(places, self.values, strict=True)]
        return [f"{self.index if rate is None else 'time_s'},{self.column}", *rows]

    def _header(self, rate: float | None) -> list[str]:
        guard, many = f"OCISAC_{self.name.upper()}_H", len(self.stored)
        rows = [f"    {', '.join(map(str, self.stored[k : k + 20]))}," for k in range(0, many, 20)]
        noted = [] if rate is None else [f"#define OCISAC_{self.index.upper()}_RATE_HZ {float(rate)!r}"]
        lines = [
            "/* " + "\n   ".join(self.comment) + " */",
            f"#ifndef {guard}",
            f"#define {guard}",
            "#include <stdint.h>",
        ]
        lines += [*noted, *self.definitions, f"static const uint8_t ocisac_{self.name}[{many}] = {{", *rows]
        return [*lines, "};", "#endif"]


SUFFIXES = (".txt", ".npy", ".csv", ".h")


def sent_chips(sent: Transmission) -> Sent:
    """The chips of a packet, for C eight in a byte, the first one most significant."""
    chips = sent.chips.tolist()
    comment = (
        f"A packet of {len(sent.payload)} bytes: send the chips one after the other, over and over.",
        "Chip k: ocisac_chips[k >> 3] >> (7 - (k & 7)) & 1, 1 = bright.",
    )
    packed = [f"0x{byte:02x}" for byte in np.packbits(sent.chips).tolist()]
    count = (f"#define OCISAC_CHIP_COUNT {len(chips)}UL",)
    return Sent("".join(map(str, chips)), sent.chips, "chip", "level", chips, "chips", packed, comment, count)


def sent_tones(sent: FskTransmission) -> Sent:
    """The tones of a packet, as indices from 0."""
    symbols = sent.symbols.tolist()
    comment = (
        f"A packet of {len(sent.payload)} bytes: send a tone for each symbol, one after the other, over and over.",
        "Symbol k: ocisac_tones_hz[ocisac_symbols[k]].",
    )
    definitions = (
        f"#define OCISAC_SYMBOL_COUNT {len(symbols)}UL",
        f"static const double ocisac_tones_hz[{len(sent.tones)}] = {{{', '.join(map(repr, sent.tones))}}};",
    )
    tones = [sent.tones[symbol] for symbol in symbols]
    text = " ".join(map(str, symbols))
    return Sent(text, sent.symbols, "symbol", "tone_hz", tones, "symbols", symbols, comment, definitions)
