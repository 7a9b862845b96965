"""Text for terminals and pipes of any encoding."""

from __future__ import annotations

import codecs
import contextlib
import io
import select
import sys
from typing import Any, TextIO

_ASCII = {"µ": "u", "μ": "u", "±": "+-", "–": "-", "─": "-", "°": "deg", "²": "^2", "·": "*", "×": "x"}


def is_utf8(stream: TextIO) -> bool:
    """True if a stream accepts all characters."""
    return codecs.lookup(stream.encoding or "ascii").name == "utf-8"


class _Messages(io.FileIO):
    """Standard error. What it does not take, full or closed by its reader, is lost, and the work goes on."""

    def write(self, text: Any) -> int:
        with contextlib.suppress(OSError):
            super().write(text)
        return len(text)


class _Results(io.FileIO):
    """Standard output, below a buffer. One that would block waits; after an error, raised once, the rest is lost."""

    _failed = False

    def write(self, data: Any) -> int:
        try:
            while not self._failed:
                if (taken := super().write(data)) is not None:
                    return taken
                select.select([], [self], [])
        except OSError:
            self._failed = True
            raise
        return len(data)


def write_any_text() -> None:
    """Write all that outputs take, with plain characters for those that their encoding lacks: 9.2 us, +-, ?."""
    codecs.register_error("ocisac", _replaced)
    if sys.stderr is sys.__stderr__ and isinstance(sys.stderr, io.TextIOWrapper):
        raw = _Messages(sys.stderr.fileno(), "w", closefd=False)
        sys.stderr = io.TextIOWrapper(raw, encoding=sys.stderr.encoding, write_through=True)
    if sys.stdout is sys.__stdout__ and isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.flush()
        as_it_comes = sys.stdout.line_buffering or sys.stdout.write_through
        buffer = io.BufferedWriter(_Results(sys.stdout.fileno(), "w", closefd=False))
        sys.stdout = io.TextIOWrapper(buffer, encoding=sys.stdout.encoding, line_buffering=as_it_comes)
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
