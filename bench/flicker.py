"""Draws the pictures of docs/explanation/exposure.md on flickering lights: ``python bench/flicker.py [-o FOLDER]``."""

from __future__ import annotations

import argparse
import pathlib

from ocisac_fast.exposure import FlickeringLight, flicker_free_exposure, mains_lights
from ocisac_fast.plots import plot_flicker_front, plot_flicker_indices, plot_lamp, plot_modulation

_DATA_LIGHT = 35.0  # Hz; suits exposures of 50 ms


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--directory", type=pathlib.Path, default=pathlib.Path("docs/explanation"))
    directory = parser.parse_args().directory
    mains = mains_lights()
    plot_modulation(mains, 0.02, path=directory / "exposure-bands.png", found=flicker_free_exposure(mains, 0.02))
    kept = flicker_free_exposure(mains, 0.02, f_comm=_DATA_LIGHT, min_gain=0.1)
    plot_flicker_front(_DATA_LIGHT, mains, 0.02, path=directory / "exposure-bands-front.png", found=kept)
    plot_lamp([1 / 60, 1 / 100], 0.02, (50.0, 5000.0), path=directory / "lamp.png")
    lamps = [FlickeringLight(90.0, duty=0.1), FlickeringLight(90.0, duty=0.5), FlickeringLight(500.0, duty=0.5)]
    plot_flicker_indices(
        [*lamps, FlickeringLight(100.0)],
        [1e-3, 11e-3],
        path=directory / "flicker-indices.png",
        background=0.05,
        contrast=0.1,
        tolerance=0.1,
    )


if __name__ == "__main__":
    main()
