"""Text for terminals and pipes of any encoding."""

from __future__ import annotations

import codecs
import contextlib
import io
import sys
from typing import Any, TextIO

_ASCII = {"µ": "u", "μ": "u", "±": "+-", "–": "-", "°": "deg", "²": "^2", "·": "*", "×": "x"}


def is_utf8(stream: TextIO) -> bool:
    """True if a stream accepts all characters."""
    return codecs.lookup(stream.encoding or "ascii").name == "utf-8"


class _Messages(io.FileIO):
    """Standard error. What it does not take, full or closed by its reader, is lost, and the work goes on."""

    def write(self, text: Any) -> int:
        with contextlib.suppress(OSError):
            super().write(text)
        return len(text)


def write_any_text() -> None:
    """Replace characters that the encoding of an output lacks by plain ones instead of an error: 9.2 us, +-, ?."""
    codecs.register_error("ocisac", _replaced)
    if sys.stderr is sys.__stderr__ and isinstance(sys.stderr, io.TextIOWrapper):
        raw = _Messages(sys.stderr.fileno(), "w", closefd=False)
        sys.stderr = io.TextIOWrapper(raw, encoding=sys.stderr.encoding, write_through=True)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="ocisac")


def _replaced(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return "".join(_ASCII.get(character, "?") for character in lacking), error.end


def one_line(message: str) -> str:
    """A message without line ends; control characters, possible in names and headers, are escaped."""
    return printable(" ".join(message.split()))


def printable(text: str) -> str:
    """A text whose control characters, which a terminal would obey, are escaped."""
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode() for character in text
    )
