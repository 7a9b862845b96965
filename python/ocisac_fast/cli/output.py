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
_Item = TypeVar("_Item")
_collected: ContextVar[list[Any] | None] = ContextVar("collected", default=None)
_csv: ContextVar[list[Any] | None] = ContextVar("csv", default=None)
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

    records: list[dict[str, Any]] = []
    tokens = _csv.set(records), _printed.set(as_json)
    try:
        yield
    finally:
        _csv.reset(tokens[0])
        _printed.reset(tokens[1])
        for path in paths if records else ():
            WRITERS.get(os.path.splitext(path)[1].lower(), write_csv)(path, records)


def is_collected() -> bool:
    """True where the objects are collected: nobody reads what a command prints or warns of."""
    return _collected.get() is not None


def emit_json(record: Mapping[str, Any]) -> None:
    """Print one JSON object on a line of standard output, or keep it for a file of ``table_of_objects``."""
    for records in (_collected.get(), _csv.get()):
        if records is not None:
            records.append(plain(record))
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


def emit_table(
    title: str,
    header_row: Sequence[str],
    rows: Iterable[Sequence[str]],
    header: bool = True,
    left: Sequence[str] = (),
    spare: Sequence[str] = (),
) -> None:
    """Print a table; with a header, columns after the first are right-aligned, except those in ``left``, of text.

    Where a terminal is too narrow, columns are left out and named below: those in ``spare`` first, then from the right.
    """
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=_UNBROKEN)
    cells = [[printable(cell) for cell in row] for row in rows]
    dropped = _too_wide(console.width, header_row, cells, left, spare) if header else []
    with console.capture() as shown:  # rich itself would end the program at a closed pipe
        _print_table(console, title, header_row, cells, header, left, dropped)
        if dropped:
            console.print(f"not shown: {', '.join(dropped)} (--json has all)\n")
    print(shown.get(), end="")


def _too_wide(
    width: int, names: Sequence[str], cells: list[list[str]], left: Sequence[str], spare: Sequence[str]
) -> list[str]:
    """The columns to leave out; those of text fold, and are narrow at the least."""
    wide = {
        name: 3 + min(max(map(len, (name, *column))), _TEXT_WIDTH if name in (*left, names[0]) else width)
        for name, *column in zip(names, *cells, strict=True)
    }
    dropped: list[str] = []
    empty = [name for name, *column in zip(names, *cells, strict=True) if not any(column)]
    for name in (*empty, *spare, *(name for name in reversed(names[1:]) if name not in left)):
        if sum(wide.values()) + 1 <= width:
            break
        if wide.pop(name, None):
            dropped.append(name)
    return [name for name in names if name in dropped]


def _print_table(
    console: Any,
    title: str,
    names: Sequence[str],
    cells: list[list[str]],
    header: bool,
    left: Sequence[str],
    dropped: Sequence[str],
) -> None:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    heading = Text(printable(title), "table.title") if title else None  # a plain one would be read as markup
    table = Table(title=heading, box=box.SIMPLE_HEAD if header else None, show_header=header)
    kept = [k for k, name in enumerate(names) if not header or name not in dropped]
    for k in kept:
        is_number = header and k > 0 and names[k] not in left
        longest = max((len(row[k]) for row in cells), default=0)
        style = "" if header or k else "bold"
        table.add_column(
            names[k],
            justify="right" if is_number else "left",
            style=style,
            overflow="fold",
            no_wrap=is_number,
            min_width=max(len(names[k]), min(longest, _TEXT_WIDTH)),
        )
    for row in cells:
        table.add_row(*(Text(row[k]) for k in kept))
    console.print(table)


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
