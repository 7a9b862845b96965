#!/usr/bin/env python3
"""The sheet of docs/measured/field.md: what goes wrong outside a laboratory, one at a time, and what is read of it.

usage: bench/field_pictures.py [--picture FILE] [--text FILE]
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from typing import Any

import calibration
import numpy as np
import numpy.typing as npt
from calibration import Draw

from ocisac_fast import transmit
from ocisac_fast.packets import PacketFormat
from ocisac_fast.plots import BLUE, RED, picture
from studies.reporting import fill_markers, markdown

EXPOSURE = 5 / 8e3  # s, five chips
CLEAN = dataclasses.replace(
    Draw.of(0),
    **{"chip_rate": 8e3, "exposure": EXPOSURE, "told_exposure": EXPOSURE, "swing": 100.0, "noise": 2.0},
    **{"rise": 0.0, "fall": 0.0, "hum": 0.0, "pwm": 0.0, "pwm_frequency": 1000.0, "texture": 0.0},
    **{"lamp_width": 16.0, "tilt": 0.0, "spot": math.inf, "jitter": 0.0},
)
CASES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("in the laboratory", {}),
    ("hum, 0.5 of the swing", {"hum": 0.5}),
    ("PWM lamp, 0.3 of the swing", {"pwm": 0.3}),
    ("texture of 20 %", {"texture": 0.2}),
    ("tilted by 6°", {"tilt": math.radians(6)}),
    ("round spot, σ 270 rows", {"spot": 270.0}),
    ("rise and fall of 0.5 chip", {"rise": 0.5, "fall": 0.5}),
    ("frames start ± 50 µs", {"jitter": 50e-6}),
    ("exposure given 10 % too long", {"told_exposure": 1.1 * EXPOSURE}),
    (
        "all at once",
        {"hum": 0.25, "texture": 0.03, "tilt": math.radians(3), "rise": 0.3, "fall": 0.3, "jitter": 50e-6},
    ),
)


@dataclasses.dataclass(frozen=True)
class Read:
    """What was read of a case.

    Attributes:
        pixels: its first frame.
        payload: frames until the payload; None: not in `calibration.FRAMES`.
        chips, wrong: of all frames.
        told: mean error rate told.
        flags: of at least half of the frames.
    """

    pixels: npt.NDArray[np.uint8]
    payload: int | None
    chips: int
    wrong: int
    told: float
    flags: tuple[str, ...]


def read(draw: Draw) -> Read:
    """Receive a case."""
    chips = transmit(calibration.PAYLOAD, format=PacketFormat(block_bytes=8)).chips
    frames = list(calibration.receive(draw))
    payloads = [number for number, frame in enumerate(frames, 1) if frame.result.payload is not None]
    names = [name for frame in frames for name in frame.result.flags.names()]
    told = np.concatenate([frame.told for frame in frames])
    return Read(
        next(draw.frames(chips)),
        payloads[0] if payloads else None,
        told.size,
        sum(int(frame.wrong.sum()) for frame in frames),
        float(told.mean()) if told.size else math.nan,
        tuple(name for name in dict.fromkeys(names) if 2 * names.count(name) >= len(frames)),
    )


def draw_sheet(path: str, results: list[Read]) -> None:
    """Draw the first frame of each case beside the mean of its columns, and what was read below."""
    across = 5
    with picture(path, 11.6, 6.2) as figure:
        grid = figure.subplots(math.ceil(len(CASES) / across), 2 * across, width_ratios=[1, 0.8] * across)
        for k, ((title, _), result) in enumerate(zip(CASES, results, strict=True)):
            shown, signal = grid[k // across, 2 * (k % across)], grid[k // across, 2 * (k % across) + 1]
            shown.imshow(result.pixels, cmap="gray", vmin=0, vmax=170, aspect="auto", interpolation="nearest")
            signal.plot(result.pixels.mean(axis=1), np.arange(calibration.ROWS), color=BLUE, lw=0.5)
            signal.set(ylim=(calibration.ROWS, 0), xlim=(0, 140))
            for axes in (shown, signal):
                axes.set_xticks([])
                axes.set_yticks([])
            shown.set_title(title, fontsize=8.5, loc="left")
            words = "no payload" if result.payload is None else f"payload after {result.payload} frames"
            colour = RED if result.payload is None else BLUE
            shown.set_xlabel(f"{words}\n{rates(result)}", fontsize=8, loc="left", color=colour)


def rates(result: Read) -> str:
    """Wrong chips, and the rate told."""
    if not result.chips:
        return "no chips"
    return f"{percent(result.wrong / result.chips)} wrong, told {percent(result.told)}"


def percent(share: float) -> str:
    """In percent, down to a millionth."""
    return "0 %" if share == 0 else f"{100 * share:.2g} %" if share >= 1e-6 else "< 0.0001 %"


def table(results: list[Read]) -> str:
    """Markdown: a line for each case."""
    rows = []
    for (title, _), result in zip(CASES, results, strict=True):
        after = "–" if result.payload is None else f"{result.payload} frames"
        rates = percent(result.wrong / max(result.chips, 1)), percent(result.told)
        rows.append((title, after, str(result.chips), *rates, ", ".join(name.upper() for name in result.flags)))
    return markdown("lrrrrl", ("what goes wrong", "payload after", "chips", "wrong", "told", "flags"), rows)


def main() -> int:
    """Read all cases."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--picture", help="draw the sheet to a .png, .svg or .pdf")
    parser.add_argument("--text", help="a Markdown file with '<!-- field: table -->', '<!-- field: end -->'")
    asked = parser.parse_args()
    results = [read(dataclasses.replace(CLEAN, **changes)) for _, changes in CASES]
    if asked.picture:
        draw_sheet(asked.picture, results)
    if asked.text:
        fill_markers(asked.text, "field", {"table": table(results)})
    print(table(results))
    return 0


if __name__ == "__main__":
    sys.exit(main())
