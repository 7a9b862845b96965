"""Files of ``ocisac transmit``, chips or tones: their common parts, and the errors of bits received from them."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.cli.output import emit_facts


def read_bits(path: str) -> npt.NDArray[np.int64]:
    """The bits of a .txt of ``transmit`` (0 and 1, and white space) or a .npy."""
    if path.lower().endswith(".npy"):
        values = np.asarray(np.load(path, allow_pickle=False)).ravel()
    else:
        with open(path, "rb") as file:
            values = np.frombuffer(b"".join(file.read().split()), np.uint8) - np.uint8(ord("0"))
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
            facts = {
                "bit error rate": f"{found.rate:.4g} (95 %: {found.low:.2g} to {found.high:.2g})",
                "errors": f"{found.errors} of {found.compared} bits",
                "missing, inserted": f"{found.missing}, {found.inserted}",
                "inverted": "yes" if found.inverted else "no",
                "by chance": f"{found.chance:.2g}" + (": unrelated bits align as well" if found.flags else ""),
            }
            emit_facts(f"source {source} against {self._path}", facts)


_ERRORS = ("errors", "compared", "missing", "inserted", "shift", "inverted", "chance")


def npy_bytes(values: npt.ArrayLike) -> bytes:
    """A .npy file."""
    buffer = io.BytesIO()
    np.save(buffer, values)
    return buffer.getvalue()


def csv_bytes(index: str, column: str, values: Sequence[object], rate: float | None) -> bytes:
    """One value per line after its index (named ``index``) or, for a known rate, its time in seconds."""
    if rate is None:
        lines = [f"{index},{column}", *(f"{k},{value}" for k, value in enumerate(values))]
    else:
        lines = [f"time_s,{column}", *(f"{k / rate!r},{value}" for k, value in enumerate(values))]
    return "\n".join(lines).encode() + b"\n"


def c_header_bytes(name: str, values: Sequence[str], comment: Sequence[str], definitions: Sequence[str]) -> bytes:
    """A C header with ``definitions`` and the bytes ``values`` as ``ocisac_NAME``."""
    guard = f"OCISAC_{name.upper()}_H"
    rows = [", ".join(values[k : k + 20]) for k in range(0, len(values), 20)]
    lines = ["/* " + "\n   ".join(comment) + " */"]
    lines += [f"#ifndef {guard}", f"#define {guard}", "#include <stdint.h>", *definitions]
    lines += [
        f"static const uint8_t ocisac_{name}[{len(values)}] = {{",
        *(f"    {row}," for row in rows),
        "};",
        "#endif",
    ]
    return "\n".join(lines).encode() + b"\n"
