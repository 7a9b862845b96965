"""Figures and picture of docs/measured/pulses.md: ``python bench/pulses.py [--recordings FOLDER] [--trials N]``.

FOLDER contains logitech_30.1hz_duty_*.mkv: a webcam's recordings of a laser of 30.1 Hz. Trials are simulated by the
exposure integral: other duties, cameras, exposures, noise, lamps that light a part of the rows, saturation, tone curve.
"""

from __future__ import annotations

import argparse
import itertools
import pathlib
import re

import numpy as np

from ocisac_fast import Camera, SquareWave, integrate_exposure
from ocisac_fast.exposure import calibrate_pulses, pulse_bands
from ocisac_fast.files import read_frames
from ocisac_fast.plots import plot_pulses

_FREQUENCY = 30.1  # Hz
_FRAME_RATE = 30.0  # 1/s
_DUTIES = np.array([0.05, 0.08, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5])
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


def measure(folder: pathlib.Path, directory: pathlib.Path) -> None:
    bands, moves = {}, []
    for path in sorted(folder.glob("logitech_30.1hz_duty_*.mkv")):
        duty = int(re.findall(r"duty_(\d+)", path.name)[0]) / 100
        light = read_frames(path).frames.mean(axis=2)
        bands[duty] = pulse_bands(light)
        moves.append(rows_moved(light))
        period, spread = bands[duty].period_rows
        print(f"{duty:.0%}  {period:.2f} ± {spread:.2f} rows a period of the lamp, {moves[-1]:+.2f} rows a frame")
    period = np.mean([one.period_rows[0] for one in bands.values()])
    frame = period - np.mean(moves)
    print(f"T_r = {1e6 / _FREQUENCY / period:.2f} µs by the lamp's period of {period:.2f} rows, 1/{_FREQUENCY} s")
    print(f"T_r = {1e6 / _FRAME_RATE / frame:.2f} µs by the frame's time of {frame:.2f} rows, 1/{_FRAME_RATE} s")
    for count in range(len(bands), 0, -1):
        for duties in itertools.combinations(sorted(bands), count):
            found = calibrate_pulses([bands[duty] for duty in duties], _FREQUENCY, duties)
            times = f"T_r = {found.row_time * 1e6:.2f} ± {found.row_time_std * 1e6:.2f} µs"
            print(*(f"{duty:.0%}" for duty in duties), times, f"offset {found.offset * 1e6:.0f} µs", sep="  ")
            if count == len(bands):
                widths = ", ".join(f"{width * 1e3:.3f}" for width in found.pulse_widths)
                exposure = f"exposure {found.exposure * 1e6:.0f} ± {found.exposure_std * 1e6:.0f} µs"
                print(f"{exposure}, misfit {found.misfit:.3f}")
                print(f"pulses of {widths} ms")
                plot_pulses(found, _FREQUENCY, duties, path=directory / "pulses.png")


def recordings(rng: np.random.Generator) -> tuple[list[np.ndarray], float, np.ndarray, float, bool]:
    """Light of the rows at two or three duties, the lamp's frequency, the duties, row time; True: light is linear."""
    rows = int(rng.integers(360, 1080))
    row_time = rng.uniform(15e-6, 60e-6) * 480 / rows
    gap, drift = rng.uniform(2, 0.3 * rows), rng.choice([-1, 1]) * rng.uniform(0.4, 3)
    duties = np.sort(rng.choice(_DUTIES, rng.choice([2, 2, 3]), replace=False))
    period = (rows + gap + drift) * row_time
    exposure = min(rng.uniform(20e-6, 40 * row_time), duties[0] * period / 1.2)
    frames = int(np.clip(1.2 * (rows + gap) / abs(drift), 300, 1200))
    camera = Camera(row_time, exposure, (rows + gap) * row_time)
    place = (np.arange(rows) - rng.uniform(0.3, 0.7) * rows) / rows
    lamps = (np.full(rows, 1.0), 0.6 + 0.4 * np.cos(20 * place), 0.07 + np.exp(-((place / 0.2) ** 2)))
    lamp = (*lamps, np.exp(-((place / 0.15) ** 2)))[rng.integers(4)]
    power, ceiling = rng.choice([1.0, 1.0, 1 / 2.2]), rng.choice([2.0, 2.0, 0.7])
    noise = 0.2 * 10 ** rng.uniform(-3, -1)
    made = []
    for duty in duties:
        wave = SquareWave(1 / period, duty=duty, phase=rng.uniform(0, 2 * np.pi))
        light = (0.02 + integrate_exposure(wave, camera, rows, frames=frames) * lamp / lamp.max()) ** power
        made.append(np.minimum(light + rng.normal(0, noise, light.shape), ceiling))
    return made, 1 / period, duties, row_time, power == 1.0 and ceiling > 1.0


def try_simulated(count: int, first: int) -> None:
    found: dict[bool, list[tuple[float, float, float, float]]] = {True: [], False: []}
    for seed in range(first, first + count):
        made, frequency, duties, row_time, is_linear = recordings(np.random.default_rng(seed))
        try:
            joint = calibrate_pulses(made, frequency, duties)
            alone = calibrate_pulses(made[:1], frequency, duties[:1])
        except ValueError as error:
            print(f"seed {seed}: {error}")
            continue
        if "one_duty" in joint.flags:
            print(f"seed {seed}: whole bands at one duty alone")
            continue
        off, off_alone = joint.row_time - row_time, alone.row_time - row_time
        errors = (off / row_time, off / joint.row_time_std, off_alone / alone.row_time_std)
        found[is_linear].append((*errors, bool(joint.flags)))
    for is_linear, name in ((True, "linear light"), (False, "tone curve or saturation")):
        share, deviation, alone, flagged = np.abs(np.array(found[is_linear])).T
        far = deviation > 3
        print(f"{name}: {share.size} calibrations from two or three duties, {np.sum(share < 0.01)} within 1 %,")
        print(f"  {np.sum(far)} beyond three standard errors, {int(np.sum(flagged[far]))} of them flagged;", end=" ")
        print(f"from one duty {np.sum(alone < 1)} within one standard error")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=pathlib.Path)
    parser.add_argument("--trials", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="seed of the first trial")
    parser.add_argument("-o", "--directory", type=pathlib.Path, default=pathlib.Path("docs/measured"))
    arguments = parser.parse_args()
    if arguments.recordings is not None:
        measure(arguments.recordings, arguments.directory)
    if arguments.trials:
        try_simulated(arguments.trials, arguments.first)


if __name__ == "__main__":
    main()
