"""Figures in a text between its markers."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ocisac_fast.files import atomic_path


def fill_markers(path: str | os.PathLike[str], kind: str, blocks: Mapping[str, str]) -> None:
    """Write every block between ``<!-- KIND: NAME -->`` and ``<!-- KIND: end -->``.

    Raises:
        ValueError: a marker of an unknown name, or no marker.
    """
    text = Path(path).read_text(encoding="utf-8")

    def filled(match: re.Match[str]) -> str:
        name = match[1]
        if name not in blocks:
            raise ValueError(f"{os.fspath(path)}: marker: got {name!r}, allowed: {', '.join(blocks)}")
        return f"<!-- {kind}: {name} -->\n{blocks[name]}\n<!-- {kind}: end -->"

    pattern = rf"<!-- {kind}: ([\w-]+) -->\n.*?<!-- {kind}: end -->"
    result, found = re.subn(pattern, filled, text, flags=re.DOTALL)
    if not found:
        allowed = f"'<!-- {kind}: NAME -->' ... '<!-- {kind}: end -->'"
        raise ValueError(f"{os.fspath(path)}: got no marker, allowed: {allowed}")
    with atomic_path(path) as temporary:
        Path(temporary).write_text(result, encoding="utf-8")


def markdown(sides: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; ``sides``: of each column, l (left) or r (right)."""
    head, *lines = (f"| {' | '.join(cells)} |" for cells in (headings, *rows))
    ruler = "|".join("---:" if side == "r" else "---" for side in sides)
    return "\n".join([head, f"|{ruler}|", *lines])


def number(value: float, digits: int = 3) -> str:
    """A number of three digits, or so many; of very small and large ones a digit less."""
    return f"{value:.{digits}g}" if 1e-3 <= abs(value) < 1e5 or value == 0.0 else f"{value:.{digits - 2}e}"
