#!/usr/bin/env python3
"""Chip errors of detection with the channel known, beside what the closest pair of sequences allows, and its speed.

Random chips through an exposure, with a rate and a phase drawn for every frame of 1080 rows; chips cut by the frame's
ends are left out. The limits are those of the project's aims; a limit is reached when the errors counted stay below it.

usage: bench/detection.py [--frames N] [--json] [--check] [--grid]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
import time

import numpy as np

import ocisac_fast as ocisac

ROWS = 1080


@dataclasses.dataclass(frozen=True)
class Case:
    """Chips of an exposure, rows of a chip, noise over the swing; the limit on the share of wrong chips."""

    exposure: float
    rows_per_chip: float
    noise: float
    limit: float | None = None


AIMS = (
    *(Case(7.0, rows, 0.02, 1e-5) for rows in (4.0, 5.0, 7.0)),
    *(Case(7.0, rows, 0.04, 1e-3) for rows in (4.0, 5.0, 7.0)),
    *(Case(14.0, rows, 0.01, 1e-4) for rows in (4.0, 7.0)),
    Case(1.0, 1.0, 0.02, 1e-3),
)
GRID = tuple(
    Case(exposure, rows, noise)
    for exposure in (0.5, 1.0, 3.0, 5.0, 7.0, 10.0)
    for rows in (2.0, 4.0, 7.0)
    for noise in (0.01, 0.02, 0.04)
)


@dataclasses.dataclass(frozen=True)
class Result:
    """Of one case. bound: errors a chip that the closest pair alone makes, Q(distance / (2 noise))."""

    case: Case
    chips: int
    wrong: int
    bound: float
    milliseconds: float

    @property
    def rate(self) -> float:
        """Share of wrong chips."""
        return self.wrong / self.chips

    @property
    def reached(self) -> bool | None:
        """None without a limit."""
        return None if self.case.limit is None else self.rate < self.case.limit


def measure(case: Case, frames: int, seed: int = 1) -> Result:
    """Errors over so many frames, and the least time of one detection."""
    random = np.random.default_rng(seed)
    wrong = total = 0
    least = math.inf
    for _ in range(frames):
        rows_per_chip = case.rows_per_chip * (1 + random.uniform(-0.01, 0.01))
        exposure = case.exposure * rows_per_chip
        first = -math.ceil(case.exposure) - 2
        count = math.ceil(ROWS / rows_per_chip) - 2 * first
        chips = random.integers(0, 2, count).astype(float)
        clock = {"rows_per_chip": rows_per_chip, "phase": random.uniform(0, rows_per_chip), "exposure": exposure}
        light = ocisac.expose_chips(chips, ROWS, **clock, first=first)
        light += case.noise * random.standard_normal(ROWS)
        begin = time.perf_counter()
        found = ocisac.chip_likelihoods(light, **clock, noise=case.noise, first=first, count=count)
        least = min(least, time.perf_counter() - begin)
        starts = clock["phase"] + (first + np.arange(count)) * rows_per_chip  # in the middle of the edges' ramps
        whole = (starts - exposure / 2 > 0) & (starts + rows_per_chip + exposure / 2 < ROWS - 1)
        wrong += int(np.sum((found > 0)[whole] != chips[whole]))
        total += int(np.sum(whole))
    distance = ocisac.closest_pair_distance(case.rows_per_chip, max(case.exposure, 1e-3) * case.rows_per_chip)
    bound = math.erfc(distance / (2 * case.noise) / math.sqrt(2)) / 2
    return Result(case, total, wrong, bound, 1e3 * least)


def print_table(results: list[Result]) -> None:
    """For people."""
    print("chips/exposure  rows/chip  noise     chips   wrong      rate  closest pair      ms  limit")
    for r in results:
        case = r.case
        limit = "" if case.limit is None else f"{case.limit:g}  {'reached' if r.reached else 'NOT REACHED'}"
        print(
            f"{case.exposure:14g}  {case.rows_per_chip:9g}  {case.noise:5.2f}  {r.chips:8d}  {r.wrong:6d}"
            f"  {r.rate:8.1e}  {r.bound:12.1e}  {r.milliseconds:6.3f}  {limit}"
        )


def main() -> int:
    """Exit code 1 with --check where a limit is not reached."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--frames", type=int, default=0, help="of each case; 0: as many as a limit needs, else 20")
    parser.add_argument("--grid", action="store_true", help="the grid of cases without limits as well")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.add_argument("--check", action="store_true", help="exit code 1 where a limit is not reached")
    arguments = parser.parse_args()
    results = []
    for case in (*AIMS, *(GRID if arguments.grid else ())):
        # Three times as many chips as one error at the limit would take.
        enough = (
            20 if case.limit is None else math.ceil(3 / case.limit / (ROWS / case.rows_per_chip - case.exposure - 2))
        )
        results.append(measure(case, arguments.frames or max(enough, 20)))
    if arguments.json:
        records = [{**dataclasses.asdict(r), "rate": r.rate, "reached": r.reached} for r in results]
        print(json.dumps({"rows": ROWS, "results": records}))
    else:
        print_table(results)
    return 1 if arguments.check and any(r.reached is False for r in results) else 0


if __name__ == "__main__":
    sys.exit(main())
