"""Text for terminals and pipes of any encoding."""

from __future__ import annotations

import codecs
import io
import sys
from typing import TextIO

_ASCII = {"µ": "u", "μ": "u", "±": "+-", "–": "-", "°": "deg", "²": "^2", "·": "*", "×": "x"}


def is_utf8(stream: TextIO) -> bool:
    """True if a stream accepts all characters."""
    return codecs.lookup(stream.encoding or "ascii").name == "utf-8"


def write_any_text() -> None:
    """Replace characters that the encoding of an output lacks by plain ones instead of an error: 9.2 us, +-, ?."""
    codecs.register_error("ocisac", _replaced)
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
    joined = " ".join(message.split())
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode() for character in joined
    )
