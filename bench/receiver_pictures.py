#!/usr/bin/env python3
"""Draws the pictures of docs/explanation/receiver.md: eye diagrams, and the trellis of an exposure of two chips."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from chip_frames import make_frame

from ocisac_fast.chips import ChipClock, expose_chips
from ocisac_fast.plots import BLACK, BLUE, ORANGE, RED, picture
from studies.drawing import shrink

if TYPE_CHECKING:
    from matplotlib.axes import Axes

EXPOSURES = (0.5, 1.0, 3.0, 7.0)  # chips
ROWS_PER_CHIP, NOISE = 8.3, 0.02
CHIPS = np.array([0, 1, 1, 0, 1, 0, 0, 1])
OTHER = np.array([0, 1, 1, 1, 0, 0, 0, 1])  # 10 instead of 01
LENGTH = 2  # exposure, chips


def draw_eyes(path: Path) -> None:
    """Draw rows over their position in a chip, from half a chip before to half a chip after; coloured by the chip."""
    with picture(path, 10.4, 3.0) as figure:
        for axes, exposure in zip(figure.subplots(1, 4, sharey=True), EXPOSURES, strict=True):
            frame = make_frame(exposure, ROWS_PER_CHIP, NOISE, np.random.default_rng(1))
            period, phase = frame.clock.rows_per_chip, frame.clock.phase
            for k in np.flatnonzero(frame.whole):
                begin = phase + (frame.first + k) * period
                rows = np.arange(np.ceil(begin - period / 2), np.floor(begin + 1.5 * period) + 1).astype(int)
                colour = BLUE if frame.chips[k] else ORANGE
                axes.plot((rows - begin) / period, frame.rows[rows], color=colour, lw=0.5, alpha=0.6)
            axes.set(
                title=f"exposure {exposure:g} chip{'s' * (exposure > 1)}", xlabel="place / chips", ylim=(-0.1, 1.1)
            )
            axes.set_xticks([-0.5, 0, 0.5, 1, 1.5])
        figure.axes[0].set_ylabel("light of a row / swing")


def draw_trellis(path: Path) -> None:
    """Draw all paths of the trellis, the sent one, and the most similar one, with the values of their rows."""
    with picture(path, 10.4, 4.6) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.3, 1])
        for chip in range(CHIPS.size):
            for state in range(4):
                for bit in (0, 1):
                    to = (2 * state + bit) & 3
                    above.plot([chip, chip + 1], [state, to], color="#cccccc", lw=1, zorder=1)
        for sequence, colour, style, label in ((OTHER, RED, "--", "10 for 01"), (CHIPS, BLUE, "-", "sent")):
            _draw_way(above, sequence, colour, style, label)
            below.plot(*_rows_of(sequence), style, color=colour, lw=1.2)
        above.set_yticks(range(4), ["00", "01", "10", "11"])
        above.set(title="Exposure of two chips: a state is the last two chips", ylabel="state", ylim=(3.4, -1.0))
        above.grid(False)
        above.legend(loc="upper right", ncols=2)
        random = np.random.default_rng(3)
        places, light = _rows_of(CHIPS)
        noisy = light + 0.04 * random.standard_normal(light.size)
        below.plot(places, noisy, ".", color=BLACK, ms=4, label="rows, noise 4 %")
        below.set(xlabel="time / chips", ylabel="light / swing", xlim=(0, CHIPS.size))
        below.legend(loc="upper right")


def _draw_way(axes: Axes, chips: np.ndarray, colour: str, style: str, label: str) -> None:
    before = np.concatenate([[0, 0], chips])
    states = 2 * before[:-1] + before[1:]
    axes.plot(range(states.size), states, style, color=colour, lw=2.2, label=label, zorder=2)
    for chip, state in enumerate(states[1:]):
        if style == "-":
            axes.annotate(
                str(chips[chip]),
                (chip + 0.5, (states[chip] + state) / 2),
                (0, 4),
                textcoords="offset points",
                color=BLUE,
            )


def _rows_of(chips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the rows' exposures in chips, and their light."""
    rows = int(CHIPS.size * ROWS_PER_CHIP)
    exposure = LENGTH * ROWS_PER_CHIP
    clock = ChipClock(rows_per_chip=ROWS_PER_CHIP, phase=exposure / 2, exposure_rows=exposure)
    light = expose_chips(np.concatenate([[0, 0], chips]), rows, clock, first=-2)
    return np.arange(rows) / ROWS_PER_CHIP, light


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("docs/explanation"))
    directory = parser.parse_args().directory
    for name, draw in (("eye.png", draw_eyes), ("trellis.png", draw_trellis)):
        draw(directory / name)
        shrink(directory / name)


if __name__ == "__main__":
    main()
