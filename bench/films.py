#!/usr/bin/env python3
"""Films without modulated light, frame by frame: lights, bits and changes of pixels, of which all are false.

A folder holds films, or folders of numbered pictures. With --bursts each picture of a folder of photographs becomes a
burst: the camera pans and zooms, with noise. Counted are frames with a light above 0.5, answers of `receive` with bits
and without a flag but SATURATED, and frames that `remove_bands` changes. Sources and licences of the films that were
measured: docs/explanation/lights.md.
"""

from __future__ import annotations

import argparse
import itertools
import json
import pathlib
from collections.abc import Iterator

import numpy as np
import photographs

from ocisac_fast import Camera, Flag, detect_sources, receive, remove_bands
from ocisac_fast.cli.pictures import grey_of
from ocisac_fast.files import FileError, open_recording, read_frames

CAMERA = Camera(2e-5)
LIKELY = 0.5
MARGIN, NOISE = 40, 1.5  # pixels around a burst's picture, DN


def burst(seed: int, photo: np.ndarray, count: int) -> np.ndarray:
    """Frames of a photograph under a slow pan and zoom, at the nearest pixels, with noise."""
    random = np.random.default_rng(seed)
    rows, columns = (n - 2 * MARGIN for n in photo.shape)
    pan = random.uniform(-MARGIN / 2, MARGIN / 2, 2) / count
    zoom = 1 + random.uniform(-0.02, 0.02) * np.arange(count) / count
    frames = []
    for k in range(count):
        at = [
            np.clip((np.arange(n) - n / 2) * zoom[k] + n / 2 + MARGIN + shift * k, 0, most - 1).round().astype(int)
            for n, shift, most in zip((rows, columns), pan, photo.shape, strict=True)
        ]
        frames.append(photo[np.ix_(*at)] + NOISE * random.standard_normal((rows, columns)))
    return np.clip(np.rint(frames), 0, 255).astype(np.uint8)


def films(folder: pathlib.Path, bursts: bool, count: int) -> Iterator[tuple[str, np.ndarray]]:
    """Name and grey frames of each film."""
    if bursts:
        for seed, photo in enumerate(photographs.read(folder)):
            yield str(seed), burst(seed, photo, count)
        return
    for path in sorted(folder.iterdir()):
        try:
            if path.is_dir():
                pictures = [read_frames(file).frames[0] for file in sorted(path.iterdir())[:count]]
            else:
                with open_recording(path) as recording:
                    pictures = list(itertools.islice(recording, count))
        except FileError:
            continue
        yield path.name, np.stack([grey_of(picture) for picture in pictures])


def judge(frames: np.ndarray, clean: bool) -> dict[str, int]:
    lit = {s.frame for s in detect_sources(frames, CAMERA) if s.probability > LIKELY}
    told = [r for r in receive(frames, CAMERA) if r.bits and not r.flags & ~Flag.SATURATED]
    changed = 0
    if clean:
        cleaned = remove_bands(frames, CAMERA).frames
        changed = int((cleaned != frames).any(axis=(1, 2)).sum())
    return {"frames": len(frames), "with_lights": len(lit), "answers_with_bits": len(told), "changed": changed}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--bursts", action="store_true", help="the folder holds photographs, of which bursts are made")
    parser.add_argument("--frames", type=int, default=30, help="frames of each film")
    parser.add_argument("--every", type=int, default=1, help="every N-th film alone")
    parser.add_argument("--no-clean", dest="clean", action="store_false")
    options = parser.parse_args()
    every = {
        name: judge(frames, options.clean)
        for name, frames in itertools.islice(
            films(options.folder, options.bursts, options.frames), 0, None, options.every
        )
    }
    sums = {key: sum(one[key] for one in every.values()) for key in next(iter(every.values()), {})}
    print(json.dumps({"films": every, **sums}))


if __name__ == "__main__":
    main()
