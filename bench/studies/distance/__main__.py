"""``python -m studies.distance``."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from ocisac_fast.cli.output import emit_json, progress
from ocisac_fast.cli.pictures import json_option
from studies.command import run
from studies.distance import SWEEPS, draw, measure, reporting

_NAMES = tuple(sweep.name for sweep in SWEEPS)


@click.command
@click.option("--sweep", "names", type=click.Choice(_NAMES), multiple=True, help="Only this sweep; repeatable.")
@click.option("--recordings", type=click.IntRange(1, 10_000), default=4, show_default=True, help="Of each link.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("distance.png"),
    show_default=True,
    help="Picture of the sweeps.",
)
@click.option(
    "--text",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="A Markdown file whose parts between '<!-- distance: NAME -->' and '<!-- distance: end -->' are updated.",
)
@json_option
def distance(
    names: tuple[str, ...], recordings: int, seed: int, output: Path, text: Path | None, as_json: bool
) -> None:
    """Film light bars on vehicles, read their packets, and compare with a detector that knows all but the chips."""
    sweeps = [sweep for sweep in SWEEPS if sweep.name in (names or _NAMES)]
    total = recordings * sum(len(sweep.links) for sweep in sweeps)
    steps = iter(progress(range(total), "recordings", total))
    results = [measure(sweep, recordings, seed, lambda: next(steps)) for sweep in sweeps]
    next(steps, None)
    draw(output, sweeps, results)
    tables = {sweep.name: reporting.table(sweep, counts) for sweep, counts in zip(sweeps, results, strict=True)}
    if text is not None:
        reporting.update_text(text, tables | reporting.comparison())
    if as_json:
        for sweep, counts in zip(sweeps, results, strict=True):
            for value, count in zip(sweep.values, counts, strict=True):
                emit_json({"sweep": sweep.name, "value": value, **vars(count)})
        return
    for name in tables:
        click.echo(f"{tables[name]}\n")
    click.echo(f"picture: {output}")


if __name__ == "__main__":
    sys.exit(run(distance))
