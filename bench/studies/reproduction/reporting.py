"""Texts and tables of the reproduction: CSV next to the pictures, tables in docs/measured/paper.md."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence

from ocisac_fast.files import atomic_path
from studies.reporting import fill_markers
from studies.reproduction import choices, gains
from studies.reproduction.figures import table_rows
from studies.reproduction.gains import GainResult

_HEADER = (
    "kind",
    "nominal",
    "frequency_hz",
    "exposure_s",
    "frames",
    "theory",
    "fit",
    "fit_std",
    "fit_scatter",
    "paper",
    "paper_std",
    "bin",
)


def write_table(path: str | os.PathLike[str], results: Sequence[GainResult]) -> None:
    """Write CSV, one line per setting."""
    with atomic_path(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_HEADER)
        for result in results:
            setting = result.setting
            light = (setting.kind, f"{setting.nominal:g}", f"{setting.frequency:.4f}", f"{setting.exposure:.6f}")
            values = (setting.theory, result.fit, result.fit_std, result.fit_scatter, result.paper, result.paper_std)
            numbers = [f"{value:.7f}" for value in values]
            writer.writerow((*light, result.frames, *numbers, f"{result.bin:.3f}"))


def update_text(path: str | os.PathLike[str], results: Sequence[GainResult]) -> None:
    """Update a Markdown file between ``<!-- reproduce: NAME -->`` and ``<!-- reproduce: end -->``.

    NAME is ``gains``, ``test``, ``deviations`` or ``table``.

    Raises:
        ValueError: a marker of an unknown name, or no marker.
    """
    blocks = {"gains": _gains(results), "test": verdict(results), "deviations": _deviations(), "table": _table()}
    fill_markers(path, "reproduce", blocks)


def verdict(results: Sequence[GainResult]) -> str:
    """Agreement of the fit's gains with theory."""
    chi, limit = gains.chi_squared(results), gains.chi_squared_limit(len(results))
    return (
        f"χ² = {chi:.1f} over {len(results)} settings (1 % point {limit:.1f}), largest deviation "
        f"{gains.worst_deviation(results):.1f} standard errors."
    )


def _gains(results: Sequence[GainResult]) -> str:
    lines = [
        "| | f / Hz | exposure / µs | m before rounding | theory | paper | bias | fit | ± | fit − theory, in σ |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for result in results:
        setting = result.setting
        cells = (
            setting.kind,
            f"{setting.frequency:.1f}",
            f"{1e6 * setting.exposure:.0f}",
            f"{result.bin:.2f}",
            f"{setting.theory:.5f}",
            f"{result.paper:.5f}",
            f"{result.bias:+.4f}",
            f"{result.fit:.5f}",
            f"{result.fit_std:.5f}",
            f"{result.deviation:+.1f}",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _deviations() -> str:
    loss = choices.deviations().loss
    return (
        f"| | printed | here |\n|---|---:|---:|\n"
        f"| mean deviation of the closed form | {100 * choices.PRINTED_MEAN:.2f} % | {100 * loss.mean():.2f} % |\n"
        f"| largest | {100 * choices.PRINTED_LARGEST:.2f} % | {100 * loss.max():.2f} % |"
    )


def _table() -> str:
    lines = ["| parameter | printed | here |", "|---|---|---|"]
    return "\n".join(lines + [f"| {' | '.join(row)} |" for row in table_rows()])
