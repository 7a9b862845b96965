"""``python -m studies.limits``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from ocisac_fast.cli.output import emit_json, emit_table
from ocisac_fast.cli.pictures import json_option
from studies import limits as catalogue
from studies.command import run
from studies.limits.reporting import number, stated


@click.command
@click.option(
    "--directory",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("limits"),
    show_default=True,
    help="Folder of limits.png.",
)
@click.option(
    "--text",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="A Markdown file whose parts between '<!-- limits: NAME -->' and '<!-- limits: end -->' are updated.",
)
@json_option
def limits(directory: Path, text: Path | None, as_json: bool) -> None:
    """Measure a plain method and the library at every known limit: errors of both, and the library's flags."""
    measured = [(limit, limit.measure()) for limit in catalogue.LIMITS]
    directory.mkdir(parents=True, exist_ok=True)
    picture = directory / "limits.png"
    catalogue.draw(picture, measured)
    if text is not None:
        catalogue.update_text(text, measured)
    if as_json:
        for limit, points in measured:
            facts = {"limit": limit.name, "sweep": limit.sweep, "error": limit.error, "plain": limit.plain}
            emit_json({**facts, "points": [_facts(limit, point) for point in points]})
        return
    rows = []
    for limit, points in measured:
        point = limit.point_at_spot(points)
        spot = f"{limit.sweep} = {point.x:g}"
        rows.append([limit.title, spot, limit.error, number(point.plain), number(point.library), stated(point)])
    header = ["limit", "at", "error", "plain", "library", "it reports"]
    emit_table("", header, rows, left=("at", "error", "it reports"))
    click.echo(f"picture: {picture}")


def _facts(limit: Any, point: Any) -> dict[str, Any]:
    return {
        "x": point.x,
        "plain": point.plain,
        "library": point.library,
        "stated": point.stated,
        "flags": point.flags.names(),
        "answer": point.answered(limit),
    }


if __name__ == "__main__":
    sys.exit(run(limits))
