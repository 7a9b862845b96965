"""The objects of ``--json`` as tables, one row per object: CSV, Parquet and MATLAB files."""

from __future__ import annotations

import csv
import json
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TextIO

import numpy as np

from ocisac_fast.files.extras import pyarrow, savemat
from ocisac_fast.files.writing import atomic_path


def write_csv(path: str, records: Iterable[Mapping[str, Any]]) -> None:
    """Write objects of JSON types to a file; ``-``: standard output."""
    if path == "-":
        _write_rows(sys.stdout, records)
        return
    with atomic_path(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        _write_rows(file, records)


def write_parquet(path: str, records: Iterable[Mapping[str, Any]]) -> None:
    """Write objects of JSON types to a file; lists of plain values stay lists."""
    names, rows = _table(records)
    arrow = pyarrow()
    table = arrow.table({name: arrow.array([row.get(name) for row in rows]) for name in names})
    with atomic_path(path) as temporary:
        pyarrow("pyarrow.parquet").write_table(table, temporary)


def write_matlab(path: str, records: Iterable[Mapping[str, Any]]) -> None:
    """Write objects of JSON types as the struct ``results`` of columns: numbers (NaN: none) or cells of texts."""
    names, rows = _table(records)
    columns = {re.sub(r"\W", "_", name): _matlab_column([row.get(name) for row in rows]) for name in names}
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        savemat()(file, {"results": columns}, long_field_names=True, oned_as="column")


def _matlab_column(values: list[Any]) -> Any:
    if all(value is None or isinstance(value, (bool, int, float)) for value in values):
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
    return np.array([_cell(value) for value in values], dtype=object)


WRITERS = {".csv": write_csv, ".parquet": write_parquet, ".mat": write_matlab}


def _table(records: Iterable[Mapping[str, Any]]) -> tuple[list[str], list[dict[str, Any]]]:
    """Names of the columns, in the order of their first appearance, and rows."""
    rows = [row for record in records for row in _rows(record)]
    return list(dict.fromkeys(name for row in rows for name in row)), rows


def _write_rows(file: TextIO, records: Iterable[Mapping[str, Any]]) -> None:
    """CSV of objects. A list of objects becomes one row per element beside the other values, an object its members.

    Lists of plain values are joined by spaces, other lists are JSON; None is empty. Columns are in the order of their
    first appearance.
    """
    names = dict.fromkeys(name for record in records for row in _rows(record) for name in row)
    table = csv.writer(file, lineterminator="\n")
    table.writerow(names)
    table.writerows([_cell(row.get(name)) for name in names] for record in records for row in _rows(record))


def _rows(record: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Rows of one object; names of list elements that the object has as well are preceded by that of the list."""
    flat: dict[str, Any] = {}
    for name, value in record.items():
        if isinstance(value, Mapping):
            flat |= {f"{name}.{inner}": each for inner, each in value.items()}
        else:
            flat[name] = value
    lists = [
        name
        for name, value in flat.items()
        if isinstance(value, list) and value and all(isinstance(each, Mapping) for each in value)
    ]
    if not lists:
        yield flat
        return
    elements = flat.pop(lists[0])
    for element in elements:
        yield flat | {f"{lists[0]}.{name}" if name in flat else name: value for name, value in element.items()}


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        plain = not any(isinstance(each, (list, Mapping)) for each in value)
        return " ".join(map(_cell, value)) if plain else json.dumps(value)
    return str(value)
