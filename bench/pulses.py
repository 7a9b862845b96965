"""Figures and picture of docs/measured/pulses.md: ``python bench/pulses.py --recordings FOLDER [-o docs/measured]``.

FOLDER contains logitech_30.1hz_duty_*.mkv: a webcam's recordings of a laser of 30.1 Hz.
"""

from __future__ import annotations

import argparse
import itertools
import pathlib
import re

from ocisac_fast.exposure import calibrate_pulses, pulse_bands
from ocisac_fast.files import read_frames
from ocisac_fast.plots import plot_pulses

_FREQUENCY = 30.1  # Hz


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=pathlib.Path, required=True)
    parser.add_argument("-o", "--directory", type=pathlib.Path, default=pathlib.Path("docs/measured"))
    arguments = parser.parse_args()
    bands = {}
    for path in arguments.recordings.glob("logitech_30.1hz_duty_*.mkv"):
        duty = int(re.findall(r"duty_(\d+)", path.name)[0]) / 100
        bands[duty] = pulse_bands(read_frames(path).frames.mean(axis=2))
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
