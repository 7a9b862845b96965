#!/usr/bin/env python3
"""Lights found in photographs without modulated light, where every one is false, and lamps put into them.

Every photograph of a folder is searched with its rows read out down and across. False lights are counted for several
`false_alarms`; then each picture gets lamps (light_probability.with_lamps), and of all lights reported at 0.9 and more
the share of lamps is counted. Sources and licences of the pictures that were measured: docs/explanation/lights.md.
"""

from __future__ import annotations

import argparse
import json
import pathlib
from collections.abc import Iterator

import light_probability
import numpy as np

from ocisac_fast import Camera, detect_sources
from ocisac_fast.cli.pictures import grey_of
from ocisac_fast.files import FileError, read_frames

# Sources of photographs by which a fit is judged, and which no fit may see: names of their files begin so. Decided on
# before the fit of the model in cpp/src/lights/light_model.hpp; its photographs are those of GCompris and scikit-image.
KEPT_OUT = ("opencv", "lomiri16", "lomiri20", "mate", "plasma", "ukui")
CAMERA = Camera(1e-5, exposure=2e-5)
MIN_SIZE = 160  # pixels, rows and columns
RATES = (1.0, 0.1, 0.01)  # false alarms a picture, the highest first
SURE = 0.9


def add_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--photographs", type=pathlib.Path, required=True, help="their folder")


def read(folder: pathlib.Path, to_fit: bool = False) -> list[np.ndarray]:
    """Grey photographs of 8 bits, in the order of their names; ``to_fit``: without those that are kept out."""
    pictures = []
    for path in sorted(folder.iterdir()):
        if to_fit and path.name.startswith(KEPT_OUT):
            continue
        try:
            picture = grey_of(read_frames(path).frames[0])
        except (FileError, OSError):
            continue
        if picture.dtype == np.uint8 and min(picture.shape) >= MIN_SIZE:
            pictures.append(picture)
    return pictures


def looks(pictures: list[np.ndarray]) -> Iterator[np.ndarray]:
    """Each picture with its rows down, and across."""
    for picture in pictures:
        yield picture
        yield np.ascontiguousarray(picture.T)


def false_lights(pictures: list[np.ndarray]) -> dict[str, float]:
    """False lights at each of RATES, beside the number asked for: the rate times the pictures looked at."""
    counts = dict.fromkeys(RATES, 0)
    for look in looks(pictures):
        for rate in RATES:
            found = len(detect_sources(look, CAMERA, false_alarms=rate))
            counts[rate] += found
            if found == 0:  # nor at a lower rate
                break
    asked = {f"asked_at_{rate}": 2 * len(pictures) * rate for rate in RATES}
    return {f"false_at_{rate}": count for rate, count in counts.items()} | asked


def sure_lights(pictures: list[np.ndarray]) -> dict[str, float]:
    """Lights reported at SURE and more where lamps were put in, and the share of them that are lamps."""
    reported = lamps = 0
    for seed, look in enumerate(looks(pictures)):
        frame, truth = light_probability.with_lamps(look, seed)
        for light in detect_sources(frame, CAMERA, false_alarms=RATES[0]):
            if light.probability < SURE or light.reflection_of is not None:
                continue
            box = light.x, light.y, light.width, light.height
            reported += 1
            lamps += light_probability.is_light(box, light.frequency, truth, light.carries_data)
    return {"reported": reported, "lamps_share": lamps / max(reported, 1)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_option(parser)
    parser.add_argument("--every", type=int, default=1, help="every N-th photograph alone")
    parser.add_argument("--lamps", action="store_true", help="put lamps into the photographs as well")
    options = parser.parse_args()
    pictures = read(options.photographs)[:: options.every]
    report = {"photographs": len(pictures), "looks": 2 * len(pictures), **false_lights(pictures)}
    if options.lamps:
        report |= sure_lights(pictures)
    print(json.dumps(report))


if __name__ == "__main__":
    main()
