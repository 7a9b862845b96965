#!/usr/bin/env python3
"""Bounds of reception: films of what cameras do, as they are and with it undone by its true parameters.

The same receiver reads both; what it reads of the second kind bounds what a model of the effect could gain.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import calibration
import cv2
import numpy as np
import numpy.typing as npt
from draws import ROWS, Draw

from ocisac_fast.scene.effects import STILL, TONE_ROWS
from studies.reporting import fill_markers, markdown

Bytes = npt.NDArray[np.uint8]
Undo = Callable[[Draw, Bytes, Bytes, Bytes], Bytes]  # draw, stored frame, frame before, frame before processing


def unmixed(draw: Draw, seen: Bytes, before: Bytes, _source: Bytes) -> Bytes:
    """Without the frame before, of which pixels that differ by less from it hold a share.

    Differences of D or more remain, smaller ones shrink to 1 - share of them: none lies between.
    """
    share = draw.level("denoise-still")
    change = before.astype(float) - seen
    mixed = np.abs(cv2.blur(change, (5, 5))) < (1 - share / 2) * 255 * STILL
    return stored(seen - mixed * share / (1 - share) * change)


def stored(values: npt.NDArray[np.float64]) -> Bytes:
    return np.asarray(np.clip(np.rint(values), 0, 255), np.uint8)


def untoned(draw: Draw, seen: Bytes, _before: Bytes, source: Bytes) -> Bytes:
    """Through the inverse of each row's table, which every value of the frame before processing has shown."""
    tones = cv2.createCLAHE(draw.level("local-tone"), (1, ROWS // TONE_ROWS))
    plain, toned = source.astype(int), np.asarray(tones.apply(source), int)
    result = seen.astype(float)
    for row in range(ROWS):
        values, places = np.unique(toned[row], return_inverse=True)
        sums = np.bincount(places, weights=plain[row])
        result[row] = (sums / np.bincount(places))[np.searchsorted(values, seen[row])]
    return stored(result)


BOUNDS: dict[str, tuple[float, Undo]] = {
    "denoise-still": (0.5, unmixed),
    "local-tone": (4.0, untoned),
}


def read(draw: Draw, undo: Undo | None) -> tuple[int, int, int | None]:
    """Wrong chips, chips, and the frames until the payload (none in FRAMES: None)."""
    wrong = chips = 0
    for number, frame in enumerate(calibration.receive(draw, undo), 1):
        wrong, chips = wrong + int(frame.wrong.sum()), chips + frame.wrong.size
        if frame.result.payload is not None:
            return wrong, chips, number
    return wrong, chips, None


def table(draws: int) -> str:
    """Markdown: a line for each effect, as filmed and undone."""
    rows = []
    for effect, (level, undo) in BOUNDS.items():
        for name, way in (("as filmed", None), ("undone", undo)):
            plain = {"chip_rate": 8e3, "told_chip_rate": 8e3, "exposure": 622e-6, "swing": 120.0, "noise": 2.0}
            read_ = [
                read(Draw(**plain, lamp_width=26.0, start=1.7 * seed, effects={effect: level}, seed=seed), way)
                for seed in range(draws)
            ]
            wrong, chips = (sum(each[k] for each in read_) for k in (0, 1))
            frames = ", ".join("none" if each[2] is None else str(each[2]) for each in read_)
            rows.append((effect, f"{level:g}", name, frames, f"{100 * wrong / max(chips, 1):.2g} %"))
    return markdown("lrlrr", ("effect", "level", "frames", "payload after", "chips wrong"), rows)


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--draws", type=int, default=4, help="films of each (default 4)")
    parser.add_argument("--text", help="a Markdown file with '<!-- bounds: table -->', '<!-- bounds: end -->'")
    asked = parser.parse_args()
    shown = table(asked.draws)
    if asked.text:
        fill_markers(asked.text, "bounds", {"table": shown})
    print(shown)


if __name__ == "__main__":
    main()
