"""Drive past a modulated traffic light with the exposure controller in the loop; a line for each policy."""

from __future__ import annotations

import argparse

import numpy as np

from studies.drive.drawing import draw
from studies.drive.simulation import NOISE_LEVEL, POLICIES, drive_past_light


def main(arguments: list[str] | None = None) -> None:
    """Print exposures, changes and the objective of each policy, as a share of the largest."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--plot", help="draw the drive to a .png, .svg or .pdf")
    parser.add_argument("--seconds", type=float, default=8.0, help="length of the drive")
    parser.add_argument("--hysteresis", type=float, default=0.01, help="of the controller")
    parser.add_argument("--no-noise", action="store_true", help="the paper's objective")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args(arguments)
    noise = None if asked.no_noise else NOISE_LEVEL
    drive = drive_past_light(seconds=asked.seconds, hysteresis=asked.hysteresis, noise_level=noise, seed=asked.seed)
    if asked.plot is not None:
        draw(asked.plot, drive)
    print("| J as a share of the largest allowed | exposures | changes | mean | min | min for the measured tones |")
    print("|---|---|---:|---:|---:|---:|")
    for name, exposure, true, known in zip(POLICIES, drive.exposure, drive.true, drive.known, strict=True):
        changes = np.count_nonzero(np.diff(exposure))
        shares = f"{true.mean():.4f} | {true.min():.3f} | {known.min():.3f}"
        print(f"| {name} | {1e3 * exposure.min():.2f}–{1e3 * exposure.max():.2f} ms | {changes} | {shares} |")


if __name__ == "__main__":
    main()
