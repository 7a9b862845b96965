"""Figures of the chart: a table next to the picture, and a text between its markers."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence

from ocisac_fast.files import atomic_path
from studies.chart.measuring import Point, beaten_by, pareto_front
from studies.chart.panels import Panel
from studies.reporting import fill_markers

Measured = Sequence[tuple[Panel, Sequence[Point]]]

_COLUMNS = (
    "panel",
    "method",
    "family",
    "precision",
    "cost",
    "cost_unit",
    "error",
    "error_unit",
    "seconds",
    "on_front",
)


def write_table(path: str | os.PathLike[str], measured: Measured) -> None:
    """Write CSV, one line per point."""
    with atomic_path(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_COLUMNS)
        for panel, points in measured:
            front = pareto_front(points)
            for p in points:
                numbers = (f"{p.cost:.4g}", panel.cost, f"{p.error:.4g}", panel.error, f"{p.seconds:.4g}")
                writer.writerow((p.panel, p.method, p.family, p.precision, *numbers, "yes" if p in front else "no"))


def update_text(path: str | os.PathLike[str], measured: Measured, setting: str) -> None:
    """Write the figures between ``<!-- chart: NAME -->`` and ``<!-- chart: end -->``.

    NAME is ``setting`` (machine and effort), ``fit`` (the place of the fit in every panel of gains) or the name of a
    panel (its points).

    Raises:
        ValueError: a marker of an unknown name, or no marker.
    """
    blocks = {"setting": setting, "fit": place_of_the_fit(measured)}
    blocks.update({panel.name: points_table(panel, points) for panel, points in measured})
    fill_markers(path, "chart", blocks)


def best_of_families(points: Sequence[Point]) -> list[Point]:
    """For each family the fastest of the points within 3 % of the most accurate one; sorted by error."""
    chosen = []
    for family in dict.fromkeys(point.family for point in points):
        own = [point for point in points if point.family == family]
        least = min(point.error for point in own)
        chosen.append(min((p for p in own if p.error <= 1.03 * least), key=lambda p: p.cost))
    return sorted(chosen, key=lambda p: p.error)


def points_table(panel: Panel, points: Sequence[Point]) -> str:
    """Markdown: every point of a labelled panel, the best of each family of the others."""
    lines = [f"| method | {panel.cost} | {panel.error} |", "|---|---:|---:|"]
    shown = points if panel.labelled else best_of_families(points)
    lines += [f"| {p.method} | {_number(p.cost)} | {_number(p.error)} |" for p in shown]
    return "\n".join(lines)


def place_of_the_fit(measured: Measured) -> str:
    """Markdown: for every panel of gains, the fastest fit as accurate as the best, and any method that beats it."""
    lines = ["| scene | fit | time | error | beaten by |", "|---|---|---:|---:|---|"]
    for panel, points in measured:
        fits = [point for point in points if point.family.startswith("fit")]
        if panel.labelled or not fits:
            continue
        rivals = [point for point in points if not point.family.startswith("fit")]
        fit = min(best_of_families(fits), key=lambda p: (p.error > 1.05 * min(q.error for q in fits), p.cost))
        better = beaten_by(fit, rivals)
        verdict = "none" if better is None else f"{better.method} ({_number(better.cost)}, {_number(better.error)})"
        lines.append(f"| {panel.title} | {fit.method} | {_number(fit.cost)} | {_number(fit.error)} | {verdict} |")
    return "\n".join(lines)


def _number(value: float) -> str:
    return f"{value:.3g}" if 1e-3 <= abs(value) < 1e5 or value == 0.0 else f"{value:.1e}"
