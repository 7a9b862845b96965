#!/usr/bin/env python3
"""Sensing compared with theory: error of f_x v and its Cramér-Rao bound, and contrast restored by the equaliser.

A full-depth cosine moves across the rows; the exposure is as on the testbed.
"""

from __future__ import annotations

import argparse
import json

import numpy as np

import ocisac_fast as ocisac
from ocisac_fast import Camera
from ocisac_fast.sensing import KnownMotion

ROW_TIME, SPEED, NOISE = 22.2e-6, 1.751, 2.0


def texture(frequency: float, exposure: float, rows: int, columns: int, mean: float, seed: int) -> np.ndarray:
    """(rows, columns), cycles of 5 columns, by eq. 7."""
    n, k = np.ogrid[:rows, :columns]
    turns = frequency * (n * ROW_TIME - exposure / 2) - 0.2 * k
    light = mean * (1 + np.sinc(frequency * exposure) * np.cos(2 * np.pi * turns))
    return light + NOISE * np.random.default_rng(seed).standard_normal(light.shape)


def frequencies(frames: int) -> list[dict[str, float]]:
    """Errors of f_x v of single frames of 720 rows and 10 columns, over the Cramér-Rao bound of a tone."""
    rows, columns, exposure = 720, 10, 1202e-6
    report = []
    for fx in (100, 200, 500):
        f = fx * SPEED
        amplitude = 100 * abs(np.sinc(f * exposure))
        bound = np.sqrt(24 * NOISE**2 / (amplitude**2 * columns * rows * (rows**2 - 1))) / (2 * np.pi * ROW_TIME)
        views = [texture(f, exposure, rows, columns, 100.0, seed) for seed in range(frames)]
        found = [
            ocisac.sense_region(one, Camera(ROW_TIME, exposure), motion=KnownMotion(axis="across")) for one in views
        ]
        error = float(np.sqrt(np.mean([(one.motion_frequency - f) ** 2 for one in found])))
        stated = float(np.mean([one.motion_frequency_std for one in found]))
        row = {"f_x_v_hz": f, "bound_hz": float(bound), "rms_error_over_bound": error / bound}
        report.append({**row, "stated_over_bound": stated / bound})
    return report


def contrasts() -> list[dict[str, float]]:
    """Contrast gain of 2000 rows of 40 columns, mean 70, before and after the inverse equaliser of boost 10."""
    report = []
    for cycles in (0.2, 0.6, 0.8, 0.9, 0.95, 0.99, 1.3, 1.5):
        f = 200 * SPEED
        view = texture(f, cycles / f, 2000, 40, 70.0, 0)
        found = ocisac.restore_contrast(view, Camera(ROW_TIME, cycles / f), f)
        row = {"f_x_v_exposure": cycles, "before": found.before, "before_std": found.before_std, "after": found.after}
        report.append({**row, "after_std": found.after_std, "expected": found.expected, "theory": found.theory})
    return report


def main() -> None:
    """Print a line for each row of both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=100)
    arguments = parser.parse_args()
    for rows in (frequencies(arguments.frames), contrasts()):
        for row in rows:
            print(json.dumps(row))


if __name__ == "__main__":
    main()
