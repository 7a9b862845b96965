"""Texts and figures of the catalogue, for docs/measured/limits.md."""

from __future__ import annotations

import math
import os
import textwrap
from collections.abc import Sequence

from studies.limits.catalogue import Limit, Point
from studies.reporting import fill_markers

Measured = Sequence[tuple[Limit, Sequence[Point]]]


def update_text(path: str | os.PathLike[str], measured: Measured) -> None:
    """Update a Markdown file between ``<!-- limits: NAME -->`` and ``<!-- limits: end -->``.

    NAME is ``figures`` (a table of all entries) or ``entries`` (their texts).

    Raises:
        ValueError: a marker of an unknown name, or no marker.
    """
    texts = "\n\n".join(entry_text(limit) for limit, _ in measured)
    fill_markers(path, "limits", {"figures": figures(measured), "entries": texts})


def figures(measured: Measured) -> str:
    """Markdown: every entry at its spot."""
    lines = ["| limit | at | error | plain | library | it reports |", "|---|---|---|---:|---:|---|"]
    for limit, points in measured:
        point = limit.point_at_spot(points)
        cells = (limit.title, f"{limit.sweep} = {point.x:g}", limit.error, number(point.plain))
        lines.append(f"| {' | '.join(cells)} | {number(point.library)} | {stated(point)} |")
    return "\n".join(lines)


def stated(point: Point) -> str:
    """Standard error and flags that the library reports."""
    spread = number(point.stated) if point.stated != 0.0 else "rounding"
    parts = [] if math.isnan(point.stated) else [f"± {spread}"]
    parts += [name.upper() for name in point.flags.names()]
    return ", ".join(parts + ["frequency reported lost"] * point.lost)


def entry_text(limit: Limit) -> str:
    """Markdown: the text of the entry."""
    words = f"{limit.plain[0].upper()}{limit.plain[1:]}. {limit.why} **Library:** {limit.then}"
    return f"### {limit.title}\n{textwrap.fill(words, 120, break_long_words=False, break_on_hyphens=False)}"


def number(value: float) -> str:
    """Format with at most three digits."""
    if math.isnan(value):
        return "NaN"
    return f"{value:.2g}" if 1e-3 <= abs(value) < 1e5 or value == 0.0 else f"{value:.0e}"
