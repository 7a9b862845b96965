#!/usr/bin/env python3
"""Error rate of chip detection, compared with the bound of the closest pair of sequences.

Random chips through an exposure, with random rate and phase for every frame of 1080 rows; chips cut by the frame's ends
are excluded. The limits are the project's aims; a limit is reached if the error rate is below it. The channel is known.
bench/timing.py measures the same with the channel estimated. --picture draws every detector's error rate over the
exposure, the theoretical one, and the bound of the closest pair.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
import time

import numpy as np
from chip_frames import ROWS, make_frame

from ocisac_fast.chips import DETECTORS, closest_pair_distance, detector_error_rates


@dataclasses.dataclass(frozen=True)
class Case:
    """Exposure in chips, rows per chip, noise over the swing; limit of the error rate."""

    exposure_chips: float
    rows_per_chip: float
    noise: float
    limit: float


AIMS = (
    *(Case(7.0, rows, 0.02, 1e-5) for rows in (4.0, 5.0, 7.0)),
    *(Case(7.0, rows, 0.04, 1e-3) for rows in (4.0, 5.0, 7.0)),
    *(Case(14.0, rows, 0.01, 1e-4) for rows in (4.0, 7.0)),
    Case(1.0, 1.0, 0.02, 1e-3),
)


def bound_of(exposure: float, rows_per_chip: float, noise: float) -> float:
    """Error rate of the closest pair of sequences alone, a lower bound for any receiver."""
    distance = closest_pair_distance(rows_per_chip, max(exposure, 1e-3) * rows_per_chip)
    return math.erfc(distance / (2 * noise) / math.sqrt(2)) / 2


def measure(
    exposure: float, rows_per_chip: float, noise: float, frames: int, method: str, seed: int = 1
) -> tuple[int, int, float]:
    """Wrong chips, chips, and the least milliseconds of a detection, over the frames."""
    random = np.random.default_rng(seed)
    wrong, total, least = 0, 0, math.inf
    for _ in range(frames):
        frame = make_frame(exposure, rows_per_chip, noise, random)
        begin = time.perf_counter()
        found = frame.detect(method)
        least = min(least, time.perf_counter() - begin)
        errors, whole = frame.errors(found)
        wrong, total = wrong + errors, total + whole
    return wrong, total, 1e3 * least


def draw(path: str, frames: int) -> None:
    """Draw the error rates of all detectors over the exposure: counted (points), theory (lines), bound (grey)."""
    from ocisac_fast.plots import BLACK, BLUE, GREEN, ORANGE, RED, SKY, picture

    looks = {"slicer": ("s", RED), "inverse": ("v", ORANGE), "wiener": ("^", GREEN), "dfe": ("D", SKY)}
    looks |= {"reduced": ("o", BLUE), "mlse": ("+", BLACK)}
    exposures = np.geomspace(0.5, 14.0, 60)
    at = (0.7, 1.0, 1.4, 2.0, 2.6, 3.4, 4.5, 5.6, 7.3, 9.4, 12.3, 14.0)
    rows_per_chip = 4.1
    with picture(path, 10.4, 4.4) as figure:
        for axes, noise in zip(figure.subplots(1, 2, sharey=True), (0.02, 0.05), strict=True):
            told = [detector_error_rates(rows_per_chip, x * rows_per_chip, noise) for x in exposures]
            for method in DETECTORS[:-1]:  # without "auto"
                marker, colour = looks.get(method, ("x", BLACK))
                longest = 10.0 if method == "mlse" else 14.0
                if hasattr(told[0], method):
                    axes.plot(exposures, [getattr(rates, method) for rates in told], color=colour, lw=1)
                counts = [(x, *measure(x, rows_per_chip, noise, frames, method)) for x in at if x <= longest]
                seen = np.array([(x, wrong / chips) for x, wrong, chips, _ in counts if wrong])
                label = method + {"dfe": " (line: first errors)", "mlse": " (line: union bound)"}.get(method, "")
                axes.plot(*(seen.T if seen.size else ([], [])), marker, color=colour, ms=5, label=label, mfc="none")
            bounds = [bound_of(x, rows_per_chip, noise) for x in exposures]
            axes.plot(exposures, bounds, color=BLACK, lw=4, alpha=0.2, label="closest pair, 01 and 10")
            axes.set(xscale="log", yscale="log", ylim=(1e-6, 1), xlabel="exposure / chips")
            axes.set_xticks([0.5, 1, 2, 4, 7, 14], ["0.5", "1", "2", "4", "7", "14"])
            axes.minorticks_off()
            axes.set_title(f"{rows_per_chip:g} rows per chip, noise {100 * noise:g} % of the swing")
        figure.axes[0].set_ylabel("wrong chips")
        figure.axes[1].legend(loc="lower left")


def main() -> int:
    """Exit code 1 with --check if a limit is not reached."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--frames", type=int, default=0, help="frames per case; 0: as many as a limit needs, else 20")
    parser.add_argument("--check", action="store_true", help="exit code 1 if a limit is not reached")
    parser.add_argument("--method", default="auto", help="the detector (default auto)")
    parser.add_argument("--picture", help="draw every detector's errors over the exposure to a .png, .svg or .pdf")
    arguments = parser.parse_args()
    if arguments.picture:
        draw(arguments.picture, arguments.frames or 40)
        return 0
    print("chips/exposure  rows/chip  noise     chips   wrong      rate  closest pair      ms  limit")
    missed = 0
    for case in AIMS:
        exposure, rows_per_chip, noise = case.exposure_chips, case.rows_per_chip, case.noise
        # Three times as many chips as contain one error at the limit.
        enough = math.ceil(3 / case.limit / (ROWS / rows_per_chip - exposure - 2))
        frames = arguments.frames or max(enough, 20)
        wrong, chips, milliseconds = measure(exposure, rows_per_chip, noise, frames, arguments.method)
        is_reached = wrong / chips < case.limit
        missed += not is_reached
        print(
            f"{exposure:14g}  {rows_per_chip:9g}  {noise:5.2f}  {chips:8d}  {wrong:6d}  {wrong / chips:8.1e}  "
            f"{bound_of(exposure, rows_per_chip, noise):12.1e}  {milliseconds:6.3f}  {case.limit:g}  "
            f"{'reached' if is_reached else 'NOT REACHED'}"
        )
    return 1 if arguments.check and missed else 0


if __name__ == "__main__":
    sys.exit(main())
