"""Output of commands: JSON lines, tables, and progress on a terminal."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from itertools import zip_longest
from tempfile import SpooledTemporaryFile
from typing import Any, Literal, TypeVar

import click
import numpy as np

from ocisac_fast.cli.text import is_utf8, printable
from ocisac_fast.core.flags import Flag, Named

# Python's representation of file name bytes that are not UTF-8, and what looks like their escapes.
_ESCAPED = re.compile(r"[\ud800-\udfff]|\\(?=x[0-9a-f]{2})")
_AS_THEY_ARE = (int, bool, type(None))
_TEXT_WIDTH = 24  # columns that a text has at the least
_IN_MEMORY = 1 << 24  # characters of a table's objects: a stream may have no end
_Item = TypeVar("_Item")
_collected: ContextVar[list[Any] | None] = ContextVar("collected", default=None)
_tabled: ContextVar[tuple[Any, bool]] = ContextVar("tabled", default=(None, True))  # a file; printed too


def plain(value: Any) -> Any:
    """Convert a value to JSON types: NumPy types to Python's, numbers that are not finite to None.

    Bytes of a file name that are not UTF-8 become escapes, such as \\xff, as does the backslash of such an escape in a
    name: names that differ stay different.
    """
    kind = type(value)
    if kind is float:
        return value if math.isfinite(value) else None
    if kind in _AS_THEY_ARE:
        return value
    if kind is str:
        is_plain = value.isascii() and "\\x" not in value
        return value if is_plain else _ESCAPED.sub(lambda found: f"\\x{ord(found[0]) & 0xFF:02x}", value)
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 0):
        return plain(value.item())
    if isinstance(value, Mapping):
        return {plain(str(key)): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item) for item in value]
    if isinstance(value, (float, str)):
        return plain(float(value) if isinstance(value, float) else str(value))
    return value


@contextlib.contextmanager
def collected_objects() -> Iterator[list[dict[str, Any]]]:
    """Collect the objects of ``emit_json`` in a list; commands run inside print nothing."""
    records: list[dict[str, Any]] = []
    token = _collected.set(records)
    try:
        yield records
    finally:
        _collected.reset(token)


@contextlib.contextmanager
def table_of_objects(paths: Sequence[str], as_json: bool) -> Iterator[None]:
    """Write the objects of ``emit_json`` to files at the end, by suffix; they are printed only if ``as_json``.

    After an interrupt or an error the files have the objects up to there, if there are any.
    """
    if not paths:
        yield
        return
    from ocisac_fast.cli.csv_files import WRITERS, write_csv

    with SpooledTemporaryFile(_IN_MEMORY, "w+", encoding="utf-8") as file:
        token = _tabled.set((file, as_json))
        try:
            yield
        finally:
            _tabled.reset(token)
            for path in paths if file.tell() else ():
                WRITERS.get(os.path.splitext(path)[1].lower(), write_csv)(path, _Lines(file))


class _Lines:
    """The objects of a file of JSON, iterated as often as needed."""

    def __init__(self, file: Any) -> None:
        self._file = file

    def __iter__(self) -> Iterator[Any]:
        self._file.seek(0)
        return map(json.loads, self._file)


def is_collected() -> bool:
    """True where the objects are collected: nobody reads what a command prints or warns of."""
    return _collected.get() is not None


def emit_json(record: Mapping[str, Any]) -> None:
    """Print one JSON object on a line of standard output, or keep it for a file of ``table_of_objects``."""
    if (records := _collected.get()) is not None:
        records.append(plain(record))
    file, is_printed = _tabled.get()
    if file is not None:
        file.write(json.dumps(plain(record)) + "\n")
    if not is_collected() and is_printed:
        print(_line(record), flush=True)


_ENCODER = json.JSONEncoder(allow_nan=False, ensure_ascii=False, default=plain)


def _line(record: Mapping[str, Any]) -> str:
    """The JSON text; few objects need ``plain`` in every value: those with numbers that are not finite, or names."""
    try:
        text = _ENCODER.encode(record)
    except (TypeError, ValueError):
        text = ""
    if text and text.isascii() and r"\\x" not in text:
        return text
    return json.dumps(plain(record), allow_nan=False, ensure_ascii=not is_utf8(sys.stdout))


def emit_summary(text: str, as_json: bool) -> None:
    """Print a line after the results; with JSON on standard error."""
    if not is_collected():
        click.echo(text, err=as_json)


def emit_note(text: str) -> None:
    """Print a line on standard error, once in a command."""
    context = click.get_current_context(silent=True)
    if context is None or is_collected():
        return
    notes: set[str] = context.meta.setdefault(__name__, set())
    if text not in notes:
        notes.add(text)
        click.echo(f"ocisac: {text}", err=True)


def emit(as_json: bool, facts: Mapping[str, Any], lines: Mapping[str, str]) -> None:
    """Print a command's one result: its JSON object, or a table of names and values."""
    if as_json:
        emit_json(facts)
    else:
        emit_facts("", lines)


def emit_facts(title: str, facts: Mapping[str, str]) -> None:
    """Print a table of names and values."""
    emit_table(title, ["", ""], [[name, value] for name, value in facts.items()], header=False)


def emit_table(title: str, header_row: Sequence[str], rows: Iterable[Sequence[str]], **options: Any) -> None:
    """Print a table; options as for ``Table``."""
    table = Table(header_row, together=None, **options)
    for row in rows:
        table.add(row, title)
    table.end(title)


class Table:
    """A table whose rows are printed as they come, below the first ones, which determine the columns.

    With a header, columns after the first are right-aligned, except those in ``left``, of text, which folds. Where a
    terminal is too narrow, columns are left out and named below: those in ``spare`` first, then from the right.
    """

    def __init__(
        self,
        names: Sequence[str],
        header: bool = True,
        left: Sequence[str] = (),
        spare: Sequence[str] = (),
        together: int | None = 8,
    ) -> None:
        """``together``: number of the first rows; None: all."""
        from rich.console import Console

        self._console = Console()
        self._room = self._console.width if self._console.is_terminal else sys.maxsize
        self._names, self._header, self._left, self._spare, self._together = names, header, left, spare, together
        self._rows: list[list[str]] = []  # to be printed
        self._longest = [0] * len(names)  # width of a cell
        self._least: list[int] = []  # width of a column at the least, where it is not to be left out
        self._widths: dict[int, int] = {}  # of the columns printed

    def add(self, row: Sequence[str], title: str) -> None:
        """Print a row, or keep it until the first ones are there."""
        from rich.cells import cell_len

        self._rows.append([printable(cell) for cell in row])
        lengths = [cell_len(cell) for cell in self._rows[-1]]
        self._longest = [max(known, length) for known, length in zip(self._longest, lengths, strict=True)]
        if self._widths or len(self._rows) == self._together:
            self._print(title)

    def flush(self, title: str) -> None:
        """Print the rows that are kept, before an error."""
        if self._rows:
            self._print(title)

    def end(self, title: str) -> None:
        """Print what is left, or a header without rows."""
        if not self._widths:
            self._print(title)
        if self._header:
            print()
        if dropped := [name for k, name in enumerate(self._names) if k not in self._widths]:
            print(f"not shown: {', '.join(dropped)} (--json has all)\n")

    def _print(self, title: str) -> None:
        """Print the rows that are kept; below another header where they do not fit those of a terminal."""
        rows, self._rows = self._rows, []
        least = [
            max(len(name), longest if self._is_number(k) else min(longest, _TEXT_WIDTH))
            for k, (name, longest) in enumerate(zip(self._names, self._longest, strict=True))
        ]
        is_new = not self._widths or (self._console.is_terminal and least != self._least)
        if is_new or not self._console.is_terminal:
            self._least, self._widths = least, self._fitted(least)
        if is_new:
            self._begin(title)
        for row in rows:
            print(*self._lines(row), sep="\n", flush=True)

    def _begin(self, title: str) -> None:
        """Print a header."""
        total = sum(self._widths.values()) + 3 * len(self._widths) - 1
        if title:
            print("", self._bold(printable(title).center(total)))
        if self._header:
            print("", *map(self._bold, self._lines(self._names)), f" {'─' * min(total, self._room - 1)}", sep="\n")

    def _bold(self, text: str) -> str:
        return click.style(text, bold=True) if self._console.color_system else text

    def _lines(self, row: Sequence[str]) -> Iterator[str]:
        """The lines of a row: text that is wider than its column folds."""
        from rich.text import Text

        sides: list[Literal["left", "right"]] = ["right" if self._is_number(k) else "left" for k in self._widths]
        cells = [
            Text(row[k]).wrap(self._console, width, justify=side, overflow="fold")
            for (k, width), side in zip(self._widths.items(), sides, strict=True)
        ]
        blanks = [Text(" " * width) for width in self._widths.values()]
        edge, between = ("  ", "   ") if self._header else (" ", "  ")
        for parts in zip_longest(*cells):
            texts = (str(part or blank) for part, blank in zip(parts, blanks, strict=True))
            yield (edge + between.join(texts)).rstrip()

    def _is_number(self, k: int) -> bool:
        return self._header and k > 0 and self._names[k] not in self._left

    def _fitted(self, least: Sequence[int]) -> dict[int, int]:
        """The columns there is room for, and their widths; lines that are still too wide wrap at the terminal."""
        kept, numbers = dict(enumerate(least)), [k for k in range(len(least)) if self._is_number(k)]
        empty = [k for k, longest in enumerate(self._longest) if not longest and self._header]
        spare = [self._names.index(name) for name in self._spare]
        for k in (*empty, *spare, *reversed(numbers)):
            if sum(kept.values()) + 3 * len(kept) + 1 <= self._room:
                break
            kept.pop(k, None)
        texts = sorted(kept.keys() - numbers, key=self._longest.__getitem__)
        free = self._room - 3 * len(kept) - 1 - sum(kept[k] for k in kept.keys() - texts)
        for count, k in enumerate(texts):  # each has its share of the room, or all that it needs
            kept[k] = max(len(self._names[k]), 1, min(self._longest[k], free // (len(texts) - count)))
            free -= kept[k]
        return kept


def quantity(value: float | None, unit: str, digits: int = 6) -> str:
    """A value with an SI prefix: 9.209 us, 4.95227 kHz; a dash if it is unknown."""
    if value is None or not math.isfinite(value):
        return "–"
    if not unit or value == 0.0:
        return f"{value:.{digits}g} {unit}".strip()
    for prefix, scale in (("G", 1e9), ("M", 1e6), ("k", 1e3), ("", 1.0), ("m", 1e-3), ("µ", 1e-6), ("n", 1e-9)):
        if abs(value) >= scale or prefix == "n":
            rounded = float(f"{value / scale:.{digits}g}")
            return f"{rounded:.{max(digits, 4)}g} {prefix}{unit}"
    raise AssertionError("unreachable")


def decibels(ratio: float) -> float:
    """A ratio of powers in dB; NaN where it is not above 0."""
    return 10.0 * math.log10(ratio) if ratio > 0.0 else math.nan


def number(value: float | None, unit: str, digits: int = 5) -> str:
    """A value in a unit without prefixes; a dash if it is unknown."""
    text = quantity(value, "", digits)
    return text if text == "–" else f"{text} {unit}"


def with_spread(value: float, spread: float | None, unit: str, digits: int = 7) -> str:
    """A value and its standard error in the same unit."""
    text = quantity(value, unit, digits)
    if spread is None or not math.isfinite(spread):
        return text
    return f"{text} ± {quantity(spread, unit, 2)}" if unit else f"{value:.{digits}g} ± {spread:.2g}"


def rate(value: float | None, spread: float | None, in_hertz: bool, digits: int = 7) -> str:
    """A frequency and its standard error, in Hz or in cycles per row."""
    text = with_spread(math.nan if value is None else value, spread, "Hz" if in_hertz else "", digits)
    return text if in_hertz or text == "–" else f"{text} cycles per row"


def progress(items: Iterable[_Item], what: str, total: int | None) -> Iterator[_Item]:
    """Iterate with a progress bar on standard error, if that is a terminal and several items are expected."""
    if is_collected() or not sys.stderr.isatty() or (total is not None and total < 2):
        yield from items
        return
    from rich.console import Console
    from rich.progress import Progress

    # Results go through the bar on one terminal with it; elsewhere they stay where they belong.
    is_shared = sys.stdout.isatty()
    with Progress(console=Console(stderr=True), transient=True, redirect_stdout=is_shared) as bar:
        yield from bar.track(items, total, description=what)


_UNIT = re.compile("_(m_s|per_m|hz|s|rad|db)$")


def facts_of(result: Any, keys: str) -> dict[str, Any]:
    """The attributes of a result that JSON keys name with their units: ``frequency_hz gain snr_db flags``."""
    facts = {key: getattr(result, _UNIT.sub("", key)) for key in keys.split()}
    made: dict[str, Callable[[Any], Any]] = {"snr_db": decibels, "flags": flag_names}
    return facts | {key: made[key](value) for key, value in facts.items() if key in made}


def flag_names(flags: Named | int) -> list[str]:
    """Lower-case names of the bits that are set; a number is a mask of ``Flag``."""
    return (flags if isinstance(flags, Named) else Flag(int(flags))).names()
