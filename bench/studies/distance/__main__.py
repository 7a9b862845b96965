"""Film light bars on vehicles, read their packets, and compare with a detector that knows all but the chips."""

from __future__ import annotations

import argparse
from pathlib import Path

from studies.distance.reporting import comparison, table
from studies.distance.sweeps import SWEEPS, draw, measure
from studies.reporting import fill_markers


def main(arguments: list[str] | None = None) -> None:
    """Draw the sweeps and print a table of each; --text: '<!-- distance: NAME -->' and '<!-- distance: end -->'."""
    names = [sweep.name for sweep in SWEEPS]
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--sweep", nargs="+", choices=names, default=names, help="only these sweeps")
    parser.add_argument("--recordings", type=int, default=4, help="of each link")
    parser.add_argument("-o", "--output", type=Path, default=Path("distance.png"), help="picture of the sweeps")
    parser.add_argument("--text", type=Path, help="a Markdown file whose tables are updated")
    asked = parser.parse_args(arguments)
    sweeps = [sweep for sweep in SWEEPS if sweep.name in asked.sweep]
    results = [measure(sweep, asked.recordings) for sweep in sweeps]
    draw(asked.output, sweeps, results)
    tables = {sweep.name: table(sweep, counts) for sweep, counts in zip(sweeps, results, strict=True)}
    if asked.text is not None:
        fill_markers(asked.text, "distance", tables | comparison())
    print("\n\n".join(tables.values()))


if __name__ == "__main__":
    main()
