"""``python -m studies.reproduction``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from ocisac_fast.cli.output import emit_json, emit_table, progress
from ocisac_fast.cli.pictures import json_option
from studies.command import run
from studies.reproduction import FIGURES, Workshop, figures, reporting, testbed

_NAMES = ("5", "6", "9", "10", "11", "12", "13", "table-2")
_QUICK = 60  # frames per setting


@click.command
@click.option("--figure", "names", type=click.Choice(_NAMES), multiple=True, help="Only this figure; repeatable.")
@click.option(
    "-o",
    "--output",
    "directory",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("paper"),
    show_default=True,
    help="Folder of the pictures and gains.csv.",
)
@click.option("--frames", type=click.IntRange(2, 100_000), help="Frames per setting.  [default: 1800, as in the paper]")
@click.option("--quick", is_flag=True, help=f"{_QUICK} frames per setting.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of noise and phases.")
@click.option(
    "--text",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="A Markdown file whose parts between '<!-- reproduce: NAME -->' and '<!-- reproduce: end -->' are updated.",
)
@json_option
def reproduce(
    names: tuple[str, ...],
    directory: Path,
    frames: int | None,
    quick: bool,
    seed: int,
    text: Path | None,
    as_json: bool,
) -> None:
    """Simulate the paper's testbed, measure it by the paper's method and by the fit, and draw the figures."""
    if quick and frames is not None:
        raise ValueError("--frames: got it with --quick, allowed: one of the two")
    count = frames or (_QUICK if quick else testbed.FRAMES)
    chosen = [FIGURES[name] for name in names or _NAMES]
    results = None
    if text is not None or any(figure.needs_gains for figure in chosen):
        calls = figures.measured_settings(count, seed)
        results = [call() for call in progress(calls, "recording and measuring", len(calls))]
    directory.mkdir(parents=True, exist_ok=True)
    pictures = []
    for figure in chosen:
        pictures.append(directory / f"{figure.name}.png")
        figures.draw(figure, pictures[-1], Workshop(results, seed))
    if results is not None:
        reporting.write_table(directory / "gains.csv", results)
        if text is not None:
            reporting.update_text(text, results)
    if as_json:
        emit_json({"settings": [_facts(result) for result in results or ()], "pictures": [str(p) for p in pictures]})
        return
    if results is not None:
        emit_table(f"Gains over {count} frames a setting", _HEADER, [_row(result) for result in results])
        click.echo(reporting.verdict(results))
    for path in pictures:
        click.echo(f"picture: {path}")


_HEADER = ["light", "frequency", "exposure", "theory", "paper's method", "bias", "fit", "± σ", "difference / σ"]


def _row(result: Any) -> list[str]:
    setting = result.setting
    return [
        setting.kind,
        f"{setting.frequency:.1f} Hz",
        f"{1e6 * setting.exposure:.0f} µs",
        f"{setting.theory:.5f}",
        f"{result.paper:.5f}",
        f"{result.bias:+.4f}",
        f"{result.fit:.5f}",
        f"{result.fit_std:.5f}",
        f"{result.deviation:+.1f}",
    ]


def _facts(result: Any) -> dict[str, Any]:
    setting = result.setting
    return {
        "kind": setting.kind,
        "frequency_hz": setting.frequency,
        "exposure_s": setting.exposure,
        "frames": result.frames,
        "theory": setting.theory,
        "gain": result.fit,
        "gain_std": result.fit_std,
        "paper_gain": result.paper,
        "paper_gain_std": result.paper_std,
        "bin": result.bin,
    }


if __name__ == "__main__":
    sys.exit(run(reproduce))
