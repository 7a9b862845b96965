#!/usr/bin/env python3
"""The sheets of docs/measured/field.md: what goes wrong outside a laboratory, one at a time, and what is read of it."""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import sys
from typing import Any

import calibration
import numpy as np
import numpy.typing as npt
from draws import ROWS, WRONG_ROW_TIME, Draw

from ocisac_fast import transmit
from ocisac_fast.packets import PacketFormat
from ocisac_fast.plots import BLUE, RED, picture
from studies.reporting import fill_markers, markdown

EXPOSURE = 5 / 8e3  # s, five chips
CLEAN = dataclasses.replace(
    Draw(8e3, 8e3, EXPOSURE, swing=100.0, noise=2.0, lamp_width=16.0, start=Draw.of(0).start, effects={}, seed=0),
    mains=Draw.of(0).mains,
)
CASES: tuple[tuple[str, dict[str, Any]], ...] = (  # changes of CLEAN
    ("in the laboratory", {}),
    ("hum, 0.5 of the swing", {"hum": 0.5}),
    ("PWM lamp, 0.3 of the swing", {"pwm": 0.3}),
    ("texture of 20 %", {"texture": 0.2}),
    ("tilted by 6°", {"tilt": math.radians(6)}),
    ("round spot, σ 270 rows", {"spot": 270.0}),
    ("rise and fall of 0.5 chip", {"rise": 0.5, "fall": 0.5}),
    ("frames start ± 50 µs", {"jitter": 50e-6}),
    ("exposure given 10 % too long", {"told_exposure": 1.1}),
    (
        "all at once",
        {"hum": 0.25, "texture": 0.03, "tilt": math.radians(3), "rise": 0.3, "fall": 0.3, "jitter": 50e-6},
    ),
)

SHOWN = 3  # frame of the sheets, of which the ones before may be a part
DEVICE = dataclasses.replace(CLEAN, lamp_width=26.0, start=1.3)
LEVELS = {  # of effects of devices
    "edge-jitter": 0.1,
    "long-runs": 0.3,
    "chopping": 20e3,
    "ripple": 0.5,
    "inverted": 1.0,
    "sender-pause": 10.0,
    "row-groups": 4.0,
    "row-pause": 5.0,
    "lens": 0.03,
    "exposure-pairs": 2.0,
    "hot-rows": 0.03,
    "auto-gain": 0.2,
    "late-frames": 0.5,
    "denoise": 0.5,
    "denoise-still": 0.35,
    "sharpen": 1.0,
    "curve": 2.0,
    "local-tone": 2.0,
    "mains": 0.5,
    "daylight": 0.2,
    "rain": 30.0,
    WRONG_ROW_TIME: 0.02,
}
SHEETS: dict[str, tuple[tuple[str, Draw], ...]] = {
    "table": tuple((title, dataclasses.replace(CLEAN, **changes)) for title, changes in CASES),
    "devices": (
        ("a plain camera", DEVICE),
        *((f"{name}={level:g}", dataclasses.replace(DEVICE, effects={name: level})) for name, level in LEVELS.items()),
    ),
}


@dataclasses.dataclass(frozen=True)
class Read:
    """A case as it was read."""

    title: str
    pixels: npt.NDArray[np.uint8]  # its frame SHOWN
    payload: int | None  # frames until it came; None: not in calibration.FRAMES
    chips: int
    wrong: int
    told: float  # mean error rate
    flags: tuple[str, ...]  # of at least half of the frames


def read(title: str, draw: Draw) -> Read:
    """Receive a case."""
    chips = transmit(calibration.PAYLOAD, format=PacketFormat(block_bytes=8)).chips
    frames, film = list(calibration.receive(draw)), (seen for seen, _ in draw.frames(chips, SHOWN))
    payloads = [number for number, frame in enumerate(frames, 1) if frame.result.payload is not None]
    names = [name for frame in frames for name in frame.result.flags.names()]
    told = np.concatenate([frame.told for frame in frames])
    return Read(
        title,
        list(itertools.islice(film, SHOWN))[-1],
        payloads[0] if payloads else None,
        told.size,
        sum(int(frame.wrong.sum()) for frame in frames),
        float(told.mean()) if told.size else math.nan,
        tuple(name for name in dict.fromkeys(names) if 2 * names.count(name) >= len(frames)),
    )


def draw_sheet(path: str, results: list[Read]) -> None:
    """Draw a frame of each case beside the mean of its columns, and what was read below."""
    across = 5
    down = math.ceil(len(results) / across)
    with picture(path, 11.6, 3.1 * down) as figure:
        grid = figure.subplots(down, 2 * across, width_ratios=[1, 0.8] * across)
        for axes in grid.ravel()[2 * len(results) :]:
            axes.remove()
        for k, result in enumerate(results):
            shown, signal = grid[k // across, 2 * (k % across)], grid[k // across, 2 * (k % across) + 1]
            shown.imshow(result.pixels, cmap="gray", vmin=0, vmax=170, aspect="auto", interpolation="nearest")
            signal.plot(result.pixels.mean(axis=1), np.arange(ROWS), color=BLUE, lw=0.5)
            signal.set(ylim=(ROWS, 0), xlim=(0, 140))
            for axes in (shown, signal):
                axes.set_xticks([])
                axes.set_yticks([])
            shown.set_title(result.title, fontsize=8.5, loc="left")
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
    for result in results:
        after = "–" if result.payload is None else f"{result.payload} frames"
        rates = percent(result.wrong / max(result.chips, 1)), percent(result.told)
        rows.append((result.title, after, str(result.chips), *rates, ", ".join(name.upper() for name in result.flags)))
    return markdown("lrrrrl", ("what goes wrong", "payload after", "chips", "wrong", "told", "flags"), rows)


def main() -> int:
    """Read all cases."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--picture", help="draw the sheet to a .png, .svg or .pdf")
    parser.add_argument("--device-picture", help="the same of effects of devices")
    parser.add_argument("--text", help="a Markdown file with '<!-- field: table -->', devices, '<!-- field: end -->'")
    asked = parser.parse_args()
    sheets = {name: [read(*case) for case in cases] for name, cases in SHEETS.items()}
    for path, results in zip((asked.picture, asked.device_picture), sheets.values(), strict=True):
        if path:
            draw_sheet(path, results)
    tables = {name: table(results) for name, results in sheets.items()}
    if asked.text:
        fill_markers(asked.text, "field", tables)
    print("\n\n".join(tables.values()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
