"""Simulate the paper's testbed, measure it by the paper's method and by the fit, and draw the figures."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from scipy.stats import chi2

from studies.reporting import fill_markers, markdown
from studies.reproduction import choices, gains, testbed
from studies.reproduction.figures import FIGURES, draw, table_rows
from studies.reproduction.gains import GainResult


def blocks(results: Sequence[GainResult]) -> dict[str, str]:
    """Figures of a text between '<!-- reproduce: NAME -->' and '<!-- reproduce: end -->'."""
    chi, limit = gains.chi_squared(results), float(chi2.ppf(0.99, len(results)))
    loss = choices.deviations().loss
    mean = ("mean deviation of the closed form", choices.PRINTED_MEAN, loss.mean())
    largest = ("largest", choices.PRINTED_LARGEST, loss.max())
    deviations = [(name, f"{100 * printed:.2f} %", f"{100 * here:.2f} %") for name, printed, here in (mean, largest)]
    return {
        "gains": _gains(results),
        "test": f"χ² = {chi:.1f} over {len(results)} settings (1 % point {limit:.1f}), largest deviation "
        f"{gains.worst_deviation(results):.1f} standard errors.",
        "deviations": markdown("lrr", ("", "printed", "here"), deviations),
        "table": markdown("lll", ("parameter", "printed", "here"), table_rows()),
    }


def _gains(results: Sequence[GainResult]) -> str:
    names = ("", "f / Hz", "exposure / µs", "m before rounding", "theory", "paper", "bias", "fit", "±")
    rows = []
    for result in results:
        setting = result.setting
        light = (setting.kind, f"{setting.frequency:.1f}", f"{1e6 * setting.exposure:.0f}", f"{result.bin:.2f}")
        paper = (f"{setting.theory:.5f}", f"{result.paper:.5f}", f"{result.bias:+.4f}")
        rows.append((*light, *paper, f"{result.fit:.5f}", f"{result.fit_std:.5f}", f"{result.deviation:+.1f}"))
    return markdown("lrrrrrrrrr", (*names, "fit − theory, in σ"), rows)


def main(arguments: list[str] | None = None) -> None:
    """Draw the figures asked for; record and measure the 24 settings where one of them or the text needs them."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("-o", "--directory", type=Path, default=Path("paper"), help="of the pictures")
    parser.add_argument("--figure", nargs="+", choices=FIGURES, default=list(FIGURES), help="only these figures")
    parser.add_argument("--frames", type=int, default=testbed.FRAMES, help="a setting; 1800, as in the paper")
    parser.add_argument("--text", type=Path, help="a Markdown file whose figures are updated")
    asked = parser.parse_args(arguments)
    asked.directory.mkdir(parents=True, exist_ok=True)
    results: list[GainResult] = []
    if asked.text is not None or any(FIGURES[name].needs_gains for name in asked.figure):
        results = [gains.measure(setting, asked.frames) for setting in testbed.settings()]
    for name in asked.figure:
        draw(name, asked.directory / f"figure-{name}.png", results)
    if asked.text is not None:
        fill_markers(asked.text, "reproduce", blocks(results))
    if results:
        print(_gains(results))


if __name__ == "__main__":
    main()
