"""Common parts of the files of ``ocisac transmit``, chips or tones."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt


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
