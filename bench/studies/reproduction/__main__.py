"""Simulate the paper's testbed, measure it by the paper's method and by the fit, and draw the figures.

usage: PYTHONPATH=bench python -m studies.reproduction [-o FOLDER] [--figure NAME...] [--frames N] [--text FILE]
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Sequence
from pathlib import Path

from studies.reporting import fill_markers
from studies.reproduction import choices, gains, testbed
from studies.reproduction.figures import FIGURES, draw, table_rows
from studies.reproduction.gains import GainResult

_HEADER = "kind nominal frequency_hz exposure_s frames theory fit fit_std fit_scatter paper paper_std bin"


def write_table(path: Path, results: Sequence[GainResult]) -> None:
    """Write CSV, one line per setting."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_HEADER.split())
        for result in results:
            setting = result.setting
            light = (setting.kind, f"{setting.nominal:g}", f"{setting.frequency:.4f}", f"{setting.exposure:.6f}")
            values = (setting.theory, result.fit, result.fit_std, result.fit_scatter, result.paper, result.paper_std)
            numbers = [f"{value:.7f}" for value in values]
            writer.writerow((*light, result.frames, *numbers, f"{result.bin:.3f}"))


def blocks(results: Sequence[GainResult]) -> dict[str, str]:
    """Figures of a text between '<!-- reproduce: NAME -->' and '<!-- reproduce: end -->'."""
    chi, limit = gains.chi_squared(results), gains.chi_squared_limit(len(results))
    loss = choices.deviations().loss
    return {
        "gains": _gains(results),
        "test": f"χ² = {chi:.1f} over {len(results)} settings (1 % point {limit:.1f}), largest deviation "
        f"{gains.worst_deviation(results):.1f} standard errors.",
        "deviations": f"| | printed | here |\n|---|---:|---:|\n"
        f"| mean deviation of the closed form | {100 * choices.PRINTED_MEAN:.2f} % | {100 * loss.mean():.2f} % |\n"
        f"| largest | {100 * choices.PRINTED_LARGEST:.2f} % | {100 * loss.max():.2f} % |",
        "table": "\n".join(
            ["| parameter | printed | here |", "|---|---|---|", *(f"| {' | '.join(row)} |" for row in table_rows())]
        ),
    }


def _gains(results: Sequence[GainResult]) -> str:
    lines = [
        "| | f / Hz | exposure / µs | m before rounding | theory | paper | bias | fit | ± | fit − theory, in σ |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for result in results:
        setting = result.setting
        light = f"| {setting.kind} | {setting.frequency:.1f} | {1e6 * setting.exposure:.0f} | {result.bin:.2f}"
        paper = f"{setting.theory:.5f} | {result.paper:.5f} | {result.bias:+.4f}"
        lines.append(f"{light} | {paper} | {result.fit:.5f} | {result.fit_std:.5f} | {result.deviation:+.1f} |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Draw the figures asked for; record and measure the 24 settings where one of them or the text needs them."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("-o", "--directory", type=Path, default=Path("paper"), help="of the pictures and gains.csv")
    parser.add_argument("--figure", nargs="+", choices=FIGURES, default=list(FIGURES), help="only these figures")
    parser.add_argument("--frames", type=int, default=testbed.FRAMES, help="a setting; 1800, as in the paper")
    parser.add_argument("--text", type=Path, help="a Markdown file whose figures are updated")
    asked = parser.parse_args(arguments)
    asked.directory.mkdir(parents=True, exist_ok=True)
    results: list[GainResult] = []
    if asked.text is not None or any(FIGURES[name].needs_gains for name in asked.figure):
        results = [gains.measure(setting, asked.frames) for setting in testbed.settings()]
        write_table(asked.directory / "gains.csv", results)
    for name in asked.figure:
        draw(name, asked.directory / f"figure-{name}.png", results)
    if asked.text is not None:
        fill_markers(asked.text, "reproduce", blocks(results))
    if results:
        print(_gains(results))


if __name__ == "__main__":
    main()
