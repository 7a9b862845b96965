"""Figures and picture of docs/measured/pulses.md: ``python bench/pulses.py --recordings FOLDER [-o docs/measured]``.

FOLDER contains logitech_30.1hz_duty_*.mkv: a webcam's recordings of a laser of 30.1 Hz.
"""

from __future__ import annotations

import argparse
import itertools
import pathlib
import re

import numpy as np

from ocisac_fast.exposure import PulseBands, calibrate_pulses, pulse_bands
from ocisac_fast.files import read_frames
from ocisac_fast.plots import plot_pulses

_FREQUENCY = 30.1  # Hz
_LARGEST_STEP = 40  # rows that a band moves from frame to frame


def rows_moved(light: np.ndarray) -> float:
    """Rows by which a band moves from one frame to the next: mean over the bands whose beginning is in both frames."""
    dark, lit = np.percentile(light, [5.0, 99.0], axis=0)
    above = light > 0.5 * (dark + lit)
    begins = [np.flatnonzero(~row[:-1] & row[1:]) for row in above]
    steps = [
        after[0] - before[0] for before, after in itertools.pairwise(begins) if before.size == 1 and after.size == 1
    ]
    return float(np.mean([step for step in steps if abs(step) < _LARGEST_STEP]))


def rows_between_frames(bands: PulseBands) -> float:
    """Rows that pass unseen: lit rows of a pulse within a frame less those of one split across two frames."""
    return float(bands.whole.mean() - bands.split.mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=pathlib.Path, required=True)
    parser.add_argument("-o", "--directory", type=pathlib.Path, default=pathlib.Path("docs/measured"))
    arguments = parser.parse_args()
    bands, periods = {}, {}
    for path in arguments.recordings.glob("logitech_30.1hz_duty_*.mkv"):
        duty = int(re.findall(r"duty_(\d+)", path.name)[0]) / 100
        light = read_frames(path).frames.mean(axis=2)
        bands[duty] = pulse_bands(light)
        unseen, moved = rows_between_frames(bands[duty]), rows_moved(light)
        periods[duty] = light.shape[1] + unseen + moved
        print(f"{duty:.0%}  {unseen:.2f} rows between frames, {moved:+.2f} rows a frame, {periods[duty]:.1f} a period")
    period, scatter = np.mean(list(periods.values())), np.std(list(periods.values()))
    print(f"a period of the lamp: {period:.1f} ± {scatter:.1f} rows, T_r = {1e6 / _FREQUENCY / period:.2f} µs")
    for count in (len(bands), 2, 1):
        for duties in itertools.combinations(sorted(bands), count):
            found = calibrate_pulses([bands[duty] for duty in duties], _FREQUENCY, duties)
            times = f"T_r = {found.row_time * 1e6:.2f} ± {found.row_time_std * 1e6:.2f} µs"
            print(*(f"{duty:.0%}" for duty in duties), times, f"offset {found.offset * 1e6:.0f} µs", sep="  ")
            if count == len(bands):
                widths = ", ".join(f"{width * 1e3:.3f}" for width in found.pulse_widths)
                exposure = f"exposure {found.exposure * 1e6:.0f} ± {found.exposure_std * 1e6:.0f} µs"
                print(f"{exposure}, misfit {found.misfit:.3f}")
                print(f"pulses of {widths} ms")
                plot_pulses(found, _FREQUENCY, duties, path=arguments.directory / "pulses.png")


if __name__ == "__main__":
    main()
