#!/usr/bin/env python3
"""Timing and channel estimation compared with their bounds, at any exposure.

Random chips with the lengthened preamble at a random place, unknown phase, exposure errors up to 3 %, rate errors up to
1 %. The preamble is detected, the channel estimated, chips detected and the channel refined over the frame. Printed for
every setting: chip errors for a known and for an estimated channel (the same detector; edge chips excluded); no if the
latter are more than twice the former (beyond chance); frames lost; frames with a clock error above 0.1 %; the
Cramer-Rao bound of the exposure and its rms error over that bound.

--anywhere measures one frame each of random decodable settings within the grid and pools them. --check: exit code 1 if
a setting is not good (`is_good`).
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from chip_frames import ROWS, ChipFrame

from ocisac_fast.chips import (
    ChannelEstimate,
    ChipClock,
    clock_bounds,
    detector_error_rates,
    expose_chips,
    find_preamble,
    refine_channel,
)

EXPOSURES = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0)  # chips
ROWS_PER_CHIP = (2.0, 4.0, 7.0)
NOISES = (0.01, 0.02, 0.04)  # of the swing
STANDARD = np.array([0] + [1] * 6 + [0] * 6 + [1], float)
LENGTHENED = np.concatenate([STANDARD, 1 - STANDARD, STANDARD])
DECODABLE = 1e-2  # error rate for a known channel above which the channel limits detection
LONGEST_TRELLIS = 10.5  # chips; above, the reduced search replaces maximum likelihood (tests compare them)


@dataclass(frozen=True)
class Frame(ChipFrame):
    """A frame with a preamble."""

    preamble_chip: int  # number of the preamble's first chip

    @property
    def inner(self) -> np.ndarray:
        """Numbers of the chips compared: one exposure away from both edges."""
        edge = math.ceil(self.clock.exposure_rows / self.clock.rows_per_chip) + 1
        return np.arange(edge, int(ROWS / self.clock.rows_per_chip) - edge)

    def wrong(self, chips: np.ndarray, first: int, shift: int) -> int:
        """Number of wrong `chips`, the first of which is number first + shift here."""
        at = self.inner - shift - first
        inside = (at >= 0) & (at < len(chips))
        sent = self.chips[self.inner - self.first]
        return int(np.sum(~inside) + np.sum(chips[at[inside]] != sent[inside]))

    def wrong_if_known(self) -> int:
        """Errors for known clock, exposure, levels and noise."""
        trellis = self.clock.exposure_rows <= LONGEST_TRELLIS * self.clock.rows_per_chip
        return self.wrong(self.detect("mlse" if trellis else "reduced") > 0, self.first, 0)


def make_frame(random: np.random.Generator, rows_per_chip: float, exposure: float, noise: float) -> Frame:
    period = rows_per_chip * (1 + random.uniform(-0.01, 0.01))
    first = -math.ceil(exposure / 2) - 2
    chips = random.integers(0, 2, int(ROWS / period) - 2 * first).astype(float)
    margin = math.ceil(exposure / 2) + 2 - first
    at = int(random.integers(margin, len(chips) - margin - len(LENGTHENED)))
    chips[at : at + len(LENGTHENED)] = LENGTHENED
    length = exposure * (1 + random.uniform(-0.03, 0.03))
    clock = ChipClock(rows_per_chip=period, phase=random.uniform(0, period), exposure_rows=length * period)
    rows = expose_chips(chips, ROWS, clock, first=first) + noise * random.standard_normal(ROWS)
    return Frame(chips, first, clock, noise, rows, first + at)


def estimate(frame: Frame, rows_per_chip: float) -> tuple[ChannelEstimate, int, float] | None:
    """Channel, errors and seconds from the rows and the preamble alone."""
    rows, begin = 20 + 100 * frame.rows, time.perf_counter()
    matches = find_preamble(rows, LENGTHENED, rows_per_chip=rows_per_chip)
    found = refine_channel(rows, matches[0].channel, known=LENGTHENED) if matches else None
    seconds = time.perf_counter() - begin
    if found is None:
        return None
    return found.channel, frame.wrong(found.chips, found.first, frame.preamble_chip), seconds


def measure(rows_per_chip: float, exposure: float, noise: float, frames: int) -> dict[str, Any]:
    random = np.random.default_rng([int(100 * rows_per_chip), int(100 * exposure), int(1000 * noise)])
    chips = wrong = wrong_genie = lost = clock_off = 0
    seconds, relative, bounds = 0.0, [], []
    for _ in range(frames):
        frame = make_frame(random, rows_per_chip, exposure, noise)
        chips += len(frame.inner)
        wrong_genie += frame.wrong_if_known()
        found = estimate(frame, rows_per_chip)
        if found is None:
            lost += 1
            wrong += len(frame.inner)
            continue
        channel, errors, spent = found
        wrong += errors
        seconds += spent
        clock_off += abs(channel.rows_per_chip / frame.clock.rows_per_chip - 1) > 1e-3
        bound = clock_bounds(frame.chips, np.full(ROWS, 1.0), frame.clock, noise=noise, first=frame.first)
        if bound is not None and np.isfinite([bound.exposure_rows_std, channel.errors.exposure_rows_std]).all():
            relative.append(channel.exposure_rows / frame.clock.exposure_rows - 1)
            bounds.append(bound.exposure_rows_std / frame.clock.exposure_rows)
    off, limit = np.array(relative), np.array(bounds)
    foretold = detector_error_rates(rows_per_chip, exposure * rows_per_chip, noise).mlse
    return {
        "exposure_chips": exposure,
        "rows_per_chip": rows_per_chip,
        "noise": noise,
        "frames": frames,
        "chips": chips,
        "chip_error_rate": wrong / chips,
        "chip_error_rate_genie": wrong_genie / chips,
        "chip_error_rate_foretold": foretold,
        "frames_lost": lost,
        "frames_clock_off": int(clock_off),
        "exposure_bound": float(np.sqrt(np.mean(limit**2))) if len(off) else None,
        "exposure_rms_over_bound": float(np.sqrt(np.mean((off / limit) ** 2))) if len(off) else None,
        "seconds_per_frame": seconds / frames,
    }


def is_good(got: dict[str, Any]) -> bool:
    """True for at most twice the errors of a detector with a known channel, if that rate is below 1e-2.

    Its errors are those counted or predicted, whichever are more. Wrong chips come in pairs (01 for 10): three standard
    deviations of that are allowed for chance.
    """
    rate = max(got["chip_error_rate_genie"], got["chip_error_rate_foretold"])
    twice = 2 * rate * got["chips"]
    return bool(got["chip_error_rate"] * got["chips"] <= twice + 3 * math.sqrt(2 * twice) or rate >= DECODABLE)


def line(got: dict[str, Any]) -> str:
    """A row of the table; `no` if :func:`is_good` is False."""
    numbers = [got[name] for name in ("exposure_bound", "exposure_rms_over_bound")]
    texts = ["   -  " if number is None else f"{number:6.3f}" for number in numbers]
    return (
        f"{got['exposure_chips']:5.1f} {got['rows_per_chip']:5.1f} {got['noise']:6.2f}  "
        f"{got['chip_error_rate_genie']:8.1e} {got['chip_error_rate']:8.1e}  {'ok' if is_good(got) else 'no'}  "
        f"{got['frames_lost']:4d} {got['frames_clock_off']:5d}  {' '.join(texts)}  "
        f"{1e3 * got['seconds_per_frame']:7.1f}"
    )


def measure_anywhere(settings: int) -> dict[str, Any]:
    """One frame of each random setting within the grid, pooled as one setting."""
    random = np.random.default_rng(0)
    frames: list[dict[str, Any]] = []
    while len(frames) < settings:
        exposure, rows_per_chip = random.uniform(0.5, 14.0), random.uniform(2.0, 7.0)
        noise = float(random.choice(NOISES))
        if detector_error_rates(rows_per_chip, exposure * rows_per_chip, noise).mlse < DECODABLE:
            frames.append(measure(rows_per_chip, exposure, noise, 1))
    got = {name: sum(frame[name] for frame in frames) for name in ("chips", "frames_lost", "frames_clock_off")}
    for name in ("chip_error_rate", "chip_error_rate_genie", "chip_error_rate_foretold"):
        got[name] = sum(frame[name] * frame["chips"] for frame in frames) / got["chips"]
    return got


def main() -> int:
    """Exit code 1 with --check if a setting is not good."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=10, help="frames per setting (default 10)")
    parser.add_argument("--exposures", nargs="+", type=float, default=EXPOSURES, help="chips (default: the grid's)")
    parser.add_argument("--anywhere", type=int, default=0, help="number of random settings, in place of the grid")
    parser.add_argument("--json", action="store_true", help="one JSON object per line instead of the table")
    parser.add_argument("--check", action="store_true", help="exit code 1 if a setting is not good")
    options = parser.parse_args()
    if options.anywhere:
        got = measure_anywhere(options.anywhere)
        print(json.dumps(got))
        return int(options.check and not is_good(got))
    if not options.json:
        print("exposure rows noise     genie estimated      lost clock   bound  rms/b  ms a frame")
        print("  chips /chip /swing  errors    errors        frames  off  of exposure")
    good = True
    for exposure, rows_per_chip, noise in itertools.product(options.exposures, ROWS_PER_CHIP, NOISES):
        got = measure(rows_per_chip, exposure, noise, options.frames)
        good = good and is_good(got)
        print(json.dumps(got) if options.json else line(got), flush=True)
    return int(options.check and not good)


if __name__ == "__main__":
    sys.exit(main())
