"""Docstrings for Sphinx: types of attributes, inherited attributes, and formulas as plain text."""

from __future__ import annotations

import inspect
import re
from typing import Any

_LITERAL = re.compile(r"(``.*?``|:\w+:`.*?`)")
_ENTRY = re.compile(r"^    ((?:\w+(?:, )?)+): ")


def add_attribute_types(app: Any, what: str, name: str, documented: Any, options: Any, lines: list[str]) -> None:
    """Event ``autodoc-process-docstring``: entries of ``Attributes:`` get the type of the annotation."""
    if what != "class":
        return
    for base in documented.__mro__[1:]:
        text = inspect.cleandoc(base.__doc__ or "") if base.__module__.startswith("ocisac_fast") else ""
        inherited = text.partition("\nAttributes:\n")[2].splitlines()
        if inherited and "Attributes:" not in lines:
            lines += ["", "Attributes:"]
        if inherited:
            lines += inherited
    types = {key: str(value) for base in documented.__mro__[::-1] for key, value in _annotations(base).items()}
    inside = False
    for number, line in enumerate(lines):
        inside = line == "Attributes:" if line and not line.startswith(" ") else inside
        entry = _ENTRY.match(line)
        if not (inside and entry):
            continue
        kinds = {types.get(each) for each in entry[1].split(", ")} - {None}
        if len(kinds) == 1:
            lines[number] = f"    {entry[1]} (``{_short(kinds.pop())}``): {line[entry.end() :]}"


def escape_formulas(app: Any, *arguments: Any) -> None:
    """|sinc| and H* are neither substitutions nor emphasis. The lines are the last argument of every such event."""
    lines = arguments[-1]
    for number, line in enumerate(lines):
        parts = _LITERAL.split(line)
        parts[::2] = [re.sub(r"(?<!\\)([|*])", r"\\\1", part) for part in parts[::2]]
        lines[number] = "".join(parts)


def _annotations(base: type) -> dict[str, Any]:
    found = dict(vars(base).get("__annotations__", {}))
    for key, value in vars(base).items():
        if isinstance(value, property) and value.fget is not None:
            found[key] = getattr(value.fget, "__annotations__", {}).get("return")
    return {key: value for key, value in found.items() if value is not None}


def _short(kind: Any) -> str:
    """``npt.NDArray[np.float64]`` as in the sources, without the names of modules."""
    return re.sub(r"\b(?:npt|np|typing|collections\.abc)\.", "", str(kind))
