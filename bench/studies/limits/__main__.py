"""Measure a plain method and the library at every known limit: errors of both, and the library's flags."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from studies.limits import LIMITS, Limit, Point, draw
from studies.reporting import fill_markers, markdown, number


def table(measured: Sequence[tuple[Limit, Sequence[Point]]]) -> str:
    """Markdown: every entry at its spot."""
    rows = []
    for limit, points in measured:
        point = limit.point_at_spot(points)
        errors = _number(point.plain), _number(point.library)
        rows.append((limit.title, f"{limit.sweep} = {point.x:g}", limit.error, *errors, _stated(point)))
    return markdown("lllrrl", ("limit", "at", "error", "plain", "library", "it reports"), rows)


def _stated(point: Point) -> str:
    """Standard error and flags that the library reports."""
    spread = _number(point.stated) if point.stated != 0.0 else "rounding"
    parts = [] if math.isnan(point.stated) else [f"± {spread}"]
    parts += [name.upper() for name in point.flags.names()]
    return ", ".join(parts + ["frequency reported lost"] * point.lost)


def _number(value: float) -> str:
    return "NaN" if math.isnan(value) else number(value, 2)


def main(arguments: list[str] | None = None) -> None:
    """Draw limits.png and write the table between '<!-- limits: figures -->' and '<!-- limits: end -->'."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("limits"), help="folder of limits.png")
    parser.add_argument("--text", type=Path, help="a Markdown file whose table is updated")
    asked = parser.parse_args(arguments)
    measured = [(limit, limit.measure()) for limit in LIMITS]
    asked.directory.mkdir(parents=True, exist_ok=True)
    draw(asked.directory / "limits.png", measured)
    if asked.text is not None:
        fill_markers(asked.text, "limits", {"figures": table(measured)})
    print(table(measured))


if __name__ == "__main__":
    main()
