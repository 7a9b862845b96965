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
from itertools import chain, zip_longest
from tempfile import SpooledTemporaryFile
from textwrap import wrap
from typing import Any, TypeVar

import click
import numpy as np

from ocisac_fast.cli.text import is_utf8, printable
from ocisac_fast.core.flags import Flag, Named

# Python's representation of file name bytes that are not UTF-8, and what looks like their escapes.
_ESCAPED = re.compile(r"[\ud800-\udfff]|\\(?=x[0-9a-f]{2})")
_AS_THEY_ARE = (int, bool, type(None))
_TEXT_WIDTH = 24  # columns that a text has at the least
_UNBROKEN = 20_000  # columns of output to a file or pipe: lines are not wrapped
_IN_MEMORY = 1 << 24  # characters of a table's objects: a stream may have no end
_Item = TypeVar("_Item")
_collected: ContextVar[list[Any] | None] = ContextVar("collected", default=None)
_tabled: ContextVar[Any] = ContextVar("tabled", default=None)
_printed: ContextVar[bool] = ContextVar("printed", default=True)


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
        tokens = _tabled.set(file), _printed.set(as_json)
        try:
            yield
        finally:
            _tabled.reset(tokens[0])
            _printed.reset(tokens[1])
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
    if (file := _tabled.get()) is not None:
        file.write(json.dumps(plain(record)) + "\n")
    if not is_collected() and _printed.get():
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

    With a header, columns after the first are right-aligned, except those in ``left``, of text. Where a terminal is too
    narrow, columns are left out and named below: those in ``spare`` first, then from the right.
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

        console = Console(highlight=False)
        self._console = console if console.is_terminal else Console(highlight=False, width=_UNBROKEN)
        self._names, self._header, self._left, self._spare, self._together = names, header, left, spare, together
        self._rows: list[list[str]] = []  # to be printed
        self._longest = [0] * len(names)  # characters of a cell
        self._least: list[int] = []  # width of a column at the least; those of text fold
        self._dropped: list[str] = []
        self._widths: list[int] = []  # of the columns printed
        self._edges: list[str] = []  # between them
        self._foot: list[str] = []

    def add(self, row: Sequence[str], title: str) -> None:
        """Print a row, or keep it until the first ones are there."""
        self._rows.append([printable(cell) for cell in row])
        self._longest = [max(known, len(cell)) for known, cell in zip(self._longest, self._rows[-1], strict=True)]
        if self._widths:
            self._go_on(title)
        elif len(self._rows) == self._together:
            self._begin(title)

    def flush(self, title: str) -> None:
        """Print the rows that are kept, before an error."""
        if self._rows:
            self._begin(title)

    def end(self, title: str) -> None:
        """Print what is left, or a header without rows."""
        if not self._widths:
            self._begin(title)
        with self._console.capture() as shown:
            if self._dropped:
                self._console.print(f"not shown: {', '.join(self._dropped)} (--json has all)\n")
        print(*self._foot, shown.get(), sep="\n", end="")

    def _begin(self, title: str) -> None:
        """Print a header and the rows that are kept."""
        self._least = self._at_least()
        self._dropped = self._too_wide() if self._header else []
        with self._console.capture() as shown:  # rich itself would end the program at a closed pipe
            self._draw(title)
        lines = shown.get().split("\n")[:-1]
        self._foot = [lines.pop()] if self._header else []
        self._edges, self._widths = re.split("-+", lines[-1]), [len(line) for line in re.findall("-+", lines.pop())]
        self._rows = []
        print(*lines, sep="\n", flush=True)

    def _go_on(self, title: str) -> None:
        """Print a row in the columns of those before; below another header where a terminal has them narrower."""
        if self._console.is_terminal and self._least != self._at_least():
            self._begin(title)
            return
        row, kept = self._rows.pop(), self._kept()
        if not self._console.is_terminal:
            self._widths = [max(width, self._longest[k]) for k, width in zip(kept, self._widths, strict=True)]
        sides = [">" if self._is_number(k) else "<" for k in kept]
        cells = [wrap(row[k], width, drop_whitespace=False) for k, width in zip(kept, self._widths, strict=True)]
        for line in zip_longest(*cells, fillvalue=""):
            parts = zip(line, sides, self._widths, strict=True)
            texts = (f"{text:{side}{width}}" for text, side, width in parts)
            print(*chain(*zip(self._edges, texts, strict=False)), self._edges[-1], sep="", flush=True)

    def _kept(self) -> list[int]:
        return [k for k, name in enumerate(self._names) if not self._header or name not in self._dropped]

    def _is_number(self, k: int) -> bool:
        return self._header and k > 0 and self._names[k] not in self._left

    def _at_least(self) -> list[int]:
        folded = (
            longest if self._is_number(k) else min(longest, _TEXT_WIDTH) for k, longest in enumerate(self._longest)
        )
        return [max(len(name), length) for name, length in zip(self._names, folded, strict=True)]

    def _too_wide(self) -> list[str]:
        """The columns to leave out."""
        names, width = self._names, self._console.width
        wide = {name: 3 + min(least, width) for name, least in zip(names, self._least, strict=True)}
        dropped: list[str] = []
        empty = [name for name, longest in zip(names, self._longest, strict=True) if not longest]
        for name in (*empty, *self._spare, *(name for name in reversed(names[1:]) if name not in self._left)):
            if sum(wide.values()) + 1 <= width:
                break
            if wide.pop(name, None):
                dropped.append(name)
        return [name for name in names if name in dropped]

    def _draw(self, title: str) -> None:
        """Draw header and rows, and a row of lines, not to be shown, that are as long as the columns are wide."""
        from rich import box
        from rich.rule import Rule
        from rich.table import Table as Drawn
        from rich.text import Text

        heading = Text(printable(title), "table.title") if title else None  # a plain one would be read as markup
        table = Drawn(title=heading, box=box.SIMPLE_HEAD if self._header else None, show_header=self._header)
        for k in self._kept():
            table.add_column(
                self._names[k],
                justify="right" if self._is_number(k) else "left",
                style="" if self._header or k else "bold",
                overflow="fold",
                no_wrap=self._is_number(k),
                min_width=max(len(self._names[k]), min(self._longest[k], _TEXT_WIDTH)),
            )
        for row in self._rows:
            table.add_row(*(Text(row[k]) for k in self._kept()))
        table.add_row(*(Rule(characters="-", style="none") for _ in self._kept()))
        self._console.print(table)


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
