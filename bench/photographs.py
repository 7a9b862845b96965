#!/usr/bin/env python3
"""Lights found in photographs without modulated light: every one is false.

The photographs are those of a folder, or the sample pictures of scikit-image where it is installed. Every one is
searched with its rows read out down and across, as it is and at half its size.

usage: bench/photographs.py [--photographs FOLDER] [--json]
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import pathlib

import numpy as np

from ocisac_fast import Camera, detect_sources
from ocisac_fast.cli.pictures import grey_of
from ocisac_fast.files import FileError, read_frames

# Sample pictures that are photographs or pages, without drawings and without chessboards, which are gratings.
SAMPLES = (
    "astronaut.png", "brick.png", "camera.png", "cell.png", "chelsea.png", "coffee.png", "coins.png", "color.png",
    "grass.png", "gravel.png", "hubble_deep_field.jpg", "ihc.png", "microaneurysms.png", "moon.png",
    "motorcycle_left.png", "motorcycle_right.png", "page.png", "retina.jpg", "rocket.jpg", "text.png",
)  # fmt: skip
CAMERA = Camera(1e-5, exposure=2e-5)
MIN_SIZE = 160  # pixels, rows and columns


def add_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--photographs", type=pathlib.Path, help="folder; default: the samples of scikit-image")


def read(folder: pathlib.Path | None) -> list[np.ndarray]:
    """Grey photographs of 8 bits, in the order of their names; none without a folder and scikit-image."""
    if folder is None:
        package = importlib.util.find_spec("skimage")
        if package is None or package.origin is None:
            return []
        paths = [pathlib.Path(package.origin).parent / "data" / name for name in SAMPLES]
    else:
        paths = sorted(folder.iterdir())
    pictures = []
    for path in paths:
        try:
            picture = grey_of(read_frames(path).frames[0])
        except (FileError, OSError):
            continue
        if picture.dtype == np.uint8 and min(picture.shape) >= MIN_SIZE:
            pictures.append(picture)
    return pictures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_option(parser)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    pictures = read(options.photographs)
    looks = [view for one in pictures for whole in (one, one.T) for view in (whole, whole[::2, ::2])]
    found = [len(detect_sources(np.ascontiguousarray(look), CAMERA)) for look in looks]
    report = {"photographs": len(pictures), "looks": len(looks), "false_lights": sum(found)}
    print(json.dumps(report) if options.json else report)


if __name__ == "__main__":
    main()
