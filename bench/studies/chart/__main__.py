"""``python -m studies.chart``."""

from __future__ import annotations

import contextlib
import platform
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click

from ocisac_fast import __version__, _core
from ocisac_fast.cli.output import emit_json, emit_table
from ocisac_fast.cli.pictures import json_option
from studies import chart as charts
from studies.command import run


@click.command
@click.option(
    "--directory",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("chart"),
    show_default=True,
    help="Folder of chart.png and chart.csv.",
)
@click.option(
    "--text",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="A Markdown file whose figures between '<!-- chart: NAME -->' and '<!-- chart: end -->' are updated.",
)
@click.option("--quick", is_flag=True, help="Few columns and short timings, for a trial.")
@json_option
def chart(directory: Path, text: Path | None, quick: bool, as_json: bool) -> None:
    """Measure every method: its time relative to reading the frame, and its error relative to the Cramér-Rao bound."""
    effort = charts.QUICK if quick else charts.FULL
    missing = charts.missing_libraries()
    if missing:
        click.echo(f"ocisac: left out, since not installed: {', '.join(missing)}", err=True)
    with _progress(sum(panel.steps for panel in charts.PANELS)) as advance:
        measured = charts.measure(effort, advance)
    directory.mkdir(parents=True, exist_ok=True)
    picture, table = directory / "chart.png", directory / "chart.csv"
    charts.draw(picture, measured)
    charts.write_table(table, measured)
    if text is not None:
        charts.update_text(text, measured, _setting(quick, missing))
    if as_json:
        emit_json(
            {
                "picture": str(picture),
                "table": str(table),
                "missing": missing,
                "panels": [
                    {"panel": panel.name, "front": [_facts(p) for p in charts.pareto_front(points)]}
                    for panel, points in measured
                ],
            }
        )
        return
    for panel, points in measured:
        rows = [[p.method, f"{p.cost:.3g}", f"{p.error:.3g}"] for p in charts.pareto_front(points)]
        emit_table(f"{panel.title}: Pareto front", ["method", panel.cost, panel.error], rows)
    click.echo(f"picture: {picture}")
    click.echo(f"table: {table}")


def _facts(point: Any) -> dict[str, Any]:
    return {"method": point.method, "cost": point.cost, "error": point.error, "seconds": point.seconds}


def _setting(quick: bool, missing: list[str]) -> str:
    processor = next(
        (line.split(":", 1)[1].strip() for line in _cpuinfo() if line.startswith("model name")), platform.machine()
    )
    left_out = f"; not installed and left out: {', '.join(missing)}" if missing else ""
    effort = " (quick run: not to be quoted)" if quick else ""
    return f"Version {__version__}, one thread of an {processor}, SIMD target {_core.simd_target()}{left_out}{effort}."


def _cpuinfo() -> list[str]:
    try:
        return Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return []


@contextlib.contextmanager
def _progress(steps: int) -> Iterator[Callable[[str], None]]:
    """A progress bar on standard error if it is a terminal."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("measuring", total=steps)
        yield lambda what: bar.update(task, advance=1, description=what[:48].ljust(48))


if __name__ == "__main__":
    sys.exit(run(chart))
