"""Time of every gain method relative to reading the frame, and its error relative to the Cramér-Rao bound."""

from __future__ import annotations

import argparse
import csv
import platform
from pathlib import Path

from ocisac_fast import __version__, _core
from studies.chart.drawing import draw
from studies.chart.methods import GAIN_METHODS
from studies.chart.panels import (
    COST,
    ERROR,
    FAST_TONE,
    Measured,
    Point,
    best_fit,
    best_of_families,
    measure,
    pareto_front,
)
from studies.reporting import fill_markers, markdown, number


def write_table(path: Path, measured: Measured) -> None:
    """Write CSV, one line per point."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("scene", "method", "precision", COST, ERROR, "seconds", "on_front"))
        for scene, points in measured:
            front = pareto_front(points)
            for p in points:
                numbers = (f"{value:.4g}" for value in (p.cost, p.error, p.seconds))
                writer.writerow((scene.name, p.method.name, p.method.precision, *numbers, p in front))


def blocks(measured: Measured, quick: bool) -> dict[str, str]:
    """Figures of a text: ``setting`` (machine and effort), ``fit`` (its place in every scene), and every scene."""
    fits, texts = [], {"setting": _setting(quick)}
    for scene, points in measured:
        if scene is not FAST_TONE:
            fit, other = best_fit(points)
            verdict = "none" if other is None else f"{other.method.name} ({', '.join(_numbers(other))})"
            fits.append((scene.title, fit.method.name, *_numbers(fit), verdict))
        shown = points if scene is FAST_TONE else best_of_families(points)
        texts[scene.name] = markdown("lrr", ("method", COST, ERROR), [(p.method.name, *_numbers(p)) for p in shown])
    return texts | {"fit": markdown("llrrl", ("scene", "fit", "time", "error", "beaten by"), fits)}


def _numbers(point: Point) -> tuple[str, str]:
    return number(point.cost), number(point.error)


def _setting(quick: bool) -> str:
    about = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    names = [line.split(":", 1)[1].strip() for line in about.splitlines() if line.startswith("model name")]
    missing = sorted({method.needs for method in GAIN_METHODS if not method.installed})
    left_out = f"; not installed and left out: {', '.join(missing)}" if missing else ""
    effort = " (quick run: not to be quoted)" if quick else ""
    processor = (names or [platform.machine()])[0]
    return f"Version {__version__}, one thread of an {processor}, SIMD target {_core.simd_target()}{left_out}{effort}."


def main(arguments: list[str] | None = None) -> None:
    """Write chart.png and chart.csv, and the figures between '<!-- chart: NAME -->' and '<!-- chart: end -->'."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("chart"), help="folder of chart.png and chart.csv")
    parser.add_argument("--text", type=Path, help="a Markdown file whose figures are updated")
    parser.add_argument("--quick", action="store_true", help="few columns and short timings, for a trial")
    asked = parser.parse_args(arguments)
    columns, frames, seconds = (240, 1, 0.02) if asked.quick else (1920, 2, 0.3)
    measured = measure(columns, frames, seconds, lambda title: print(title, flush=True))
    asked.directory.mkdir(parents=True, exist_ok=True)
    draw(asked.directory / "chart.png", measured)
    write_table(asked.directory / "chart.csv", measured)
    if asked.text is not None:
        fill_markers(asked.text, "chart", blocks(measured, asked.quick))


if __name__ == "__main__":
    main()
