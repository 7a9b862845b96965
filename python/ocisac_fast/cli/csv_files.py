"""The objects of ``--json`` as CSV files: one line of names, then one row per object."""

from __future__ import annotations

import csv
import io
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ocisac_fast.files.writing import atomic_path


def write_csv(path: str, records: Sequence[Mapping[str, Any]]) -> None:
    """Write objects of JSON types to a file; ``-``: standard output."""
    text = csv_text(records)
    if path == "-":
        sys.stdout.write(text)
        return
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")


def csv_text(records: Sequence[Mapping[str, Any]]) -> str:
    """CSV of objects. A list of objects becomes one row per element beside the other values, an object its members.

    Lists of plain values are joined by spaces, other lists are JSON; None is empty. Columns are in the order of their
    first appearance.
    """
    rows = [row for record in records for row in _rows(record)]
    names = list(dict.fromkeys(name for row in rows for name in row))
    buffer = io.StringIO()
    table = csv.writer(buffer, lineterminator="\n")
    table.writerow(names)
    table.writerows([_cell(row.get(name)) for name in names] for row in rows)
    return buffer.getvalue()


def _rows(record: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Rows of one object; names of list elements that the object has as well are preceded by that of the list."""
    flat: dict[str, Any] = {}
    for name, value in record.items():
        if isinstance(value, Mapping):
            flat |= {f"{name}.{inner}": each for inner, each in value.items()}
        else:
            flat[name] = value
    lists = [name for name, value in flat.items() if _is_list_of_objects(value)]
    if not lists:
        yield flat
        return
    elements = flat.pop(lists[0])
    for element in elements:
        yield flat | {f"{lists[0]}.{name}" if name in flat else name: value for name, value in element.items()}


def _is_list_of_objects(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(each, Mapping) for each in value)


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        plain = not any(isinstance(each, (list, Mapping)) for each in value)
        return " ".join(map(_cell, value)) if plain else json.dumps(value)
    return str(value)
