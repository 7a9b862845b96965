#!/usr/bin/env python3
"""Random scenes under zero to two lamps, as films of a few frames, cleaned as `ocisac clean` does: it must never harm.

Bands of 20 to 2,000 rows a cycle, 480p to 4K, still, panned or shaken, noise of 1.5 DN of 255, a lamp that lights all
alike or some parts more; sRGB, a third of the films HLG; half of them coded: H.264 or HEVC of 8 or 10 bits, limited
range, crf 18 to 28. For each scene, over its frames: the least and the median gain of PSNR to the scene
without bands (peak 255, one gain for all colours), how far it is behind that of the true light divided out, the largest
growth of the cast (DN), of the share of burnt pixels (254 or more) and of the amplitude of the row means of
ln(picture/truth) at the lights' own frequencies; and which limit is broken.

--markdown: no scenes are made; a table of those whose lines are in a file, a row for each kind.

usage: bench/cleaning_scenes.py [--first SEED] [--count N] [--largest ROWS] [--plain] [--markdown FILE]
"""

from __future__ import annotations

import argparse
import collections
import json
import pathlib
import tempfile
import time
from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import Any

import av
import cleaning as bands
import numpy as np
import numpy.typing as npt

from ocisac_fast import Camera
from ocisac_fast.camera.linear_light import linear_light, stored_values
from ocisac_fast.cleaning import VideoCleaner
from ocisac_fast.files import read_frames

Array = npt.NDArray[Any]
SIZES = ((480, 640), (600, 800), (720, 1280), (1080, 1440), (1080, 1920), (2160, 3840))
FRAMES, FRAME_TIME, BYTES = 6, 1 / 30, np.dtype(np.uint8)
WAITING = 3  # unchanged frames that `ocisac clean` holds
TRANSFERS = {"srgb": 13, "hlg": 18}  # numbers of ITU-T H.273
CHROMA = np.array([[-0.1146, -0.3854, 0.5], [0.5, -0.4542, -0.0458]])  # BT.709
LIMITS = {"least_gain_db": -0.1, "cast": 1.0, "burnt": 0.002, "swing": 1e-3, "behind_db": 1.5}


def reflectance(rows: int, columns: int, random: np.random.Generator) -> Array:
    """(rows, columns, 3) of a room: clouds, shades, a vignette, a table's edge, boxes, lines of text."""
    picture = np.broadcast_to(random.uniform(0.25, 0.7, 3), (rows, columns, 3)).copy()
    if random.random() < 0.5:
        picture *= np.exp(random.uniform(0.1, 0.35) * bands.clouds(rows, columns, random))[..., None]
    y, x = np.linspace(-1, 1, rows)[:, None], np.linspace(-1, 1, columns)
    shade, slope = random.uniform(0, 0.4), random.normal(0, 0.3, 2)
    picture *= np.exp(slope[0] * y + slope[1] * x - shade * (x**2 + y**2))[..., None]
    if random.random() < 0.4:
        picture[int(random.uniform(0.4, 0.8) * rows) :] *= random.uniform(0.3, 1.5, 3)
    for _ in range(random.integers(5, 60)):
        height, width = (int(random.uniform(0.02, 0.4) * side) + 4 for side in (rows, columns))
        top, left = random.integers(0, rows - height // 2), random.integers(0, columns - width // 2)
        picture[top : top + height, left : left + width] = random.uniform(0.05, 0.9) * random.uniform(0.5, 1, 3)
    if random.random() < 0.3:
        top, left, step = random.integers(0, rows // 2), random.integers(0, columns // 2), random.integers(12, 40)
        for k in range(random.integers(4, 14)):
            picture[top + k * step : top + k * step + step // 4, left : left + columns // 3] *= 0.3
    return np.clip(picture, 0.02, 0.95)


def film(seed: int, largest: int, curve: str) -> tuple[dict[str, Any], Camera, Array, list[tuple[Array, Array, Array]]]:
    """Facts of the scene; the camera; rows a cycle of the lamps; stored and true frames, and the light's factor."""
    random = np.random.default_rng(seed)
    sizes = [size for size in SIZES if size[0] <= largest]
    rows, columns = sizes[random.integers(len(sizes))]
    period = float(np.exp(random.uniform(np.log(20), np.log(2000))))
    lamps = int(random.choice(3, p=[0.2, 0.6, 0.2]))
    motion = str(random.choice(["still", "pan", "shake"]))
    speed = {"still": np.zeros((FRAMES, 2)), "shake": random.normal(0, 3, (FRAMES, 2))}
    ways = speed.get(motion, np.arange(FRAMES)[:, None] * random.uniform(1, 12, 2))
    ways = np.rint(ways - ways.min(axis=0)).astype(int)
    picture = reflectance(rows + ways[:, 0].max(), columns + ways[:, 1].max(), random)
    picture *= 0.8 * 255 * random.uniform(0.5, 1.0) / picture.max()
    camera = Camera(FRAME_TIME / rows * random.uniform(0.5, 0.98), frame_time=FRAME_TIME, tone_curve=curve)
    periods = period / np.array([1.0, random.uniform(1.3, 2.2)])[:lamps]
    depths = random.uniform(0.08, 0.45, lamps) * (1.0 if lamps < 2 else 0.6)
    y, x = np.mgrid[-1 : 1 : picture.shape[0] * 1j, -1 : 1 : picture.shape[1] * 1j]
    edge = (x + 0.3 * y - random.uniform(-0.5, 0.5)) * random.uniform(2, 20)
    is_even = random.random() < 0.67
    share = np.ones_like(x) if is_even else 0.25 + 0.75 / (1 + np.exp(edge))
    phases = random.uniform(0, 2 * np.pi, lamps)
    frames = []
    for k, (down, right) in enumerate(ways):
        at = np.arange(rows) + k * FRAME_TIME / camera.row_period
        wave = (depths * np.sin(2 * np.pi * at[:, None] / periods + phases)).sum(axis=1)
        part = np.s_[down : down + rows, right : right + columns]
        left = 1 + share[part][..., None] * wave[:, None, None]
        read = stored_values(picture[part] * left, camera, BYTES) + random.normal(0, 1.5, (*left.shape[:2], 3))
        truth = stored_values(picture[part], camera, BYTES).astype(float)
        frames.append((np.clip(np.rint(read), 0, 255).astype(np.uint8), truth, left))
    facts = {"seed": seed, "rows": rows, "periods": periods.round().tolist(), "depths": depths.round(2).tolist()}
    return {**facts, "motion": motion, "is_even": is_even}, camera, periods, frames


def coded(frames: Array, curve: str, random: np.random.Generator) -> tuple[str, Array]:
    """How a film of frames (frames, rows, columns, colours) was coded, and what is decoded from it, of 8 bits."""
    codec, depth = ("libx264", "libx265")[random.integers(2)], (8, 10)[random.integers(2)]
    crf, pixels = int(random.integers(18, 29)), "yuv420p" if depth == 8 else "yuv420p10le"
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "film.mp4"
        with av.open(str(path), "w") as container:
            options = {"crf": str(crf), "preset": "veryfast", "x265-params": "log-level=none"}
            stream = container.add_stream(codec, rate=Fraction(1 / FRAME_TIME).limit_denominator(), options=options)
            stream.height, stream.width = frames.shape[1:3]
            stream.pix_fmt = pixels
            context = stream.codec_context
            context.color_primaries, context.colorspace, context.color_range = 1, 1, 1
            context.color_trc = TRANSFERS[curve]
            for frame in frames:
                shown = av.VideoFrame.from_ndarray(frame, format="rgb24")
                shown = shown.reformat(format=pixels, dst_colorspace="ITU709", dst_color_range="MPEG")
                container.mux(stream.encode(shown))
            container.mux(stream.encode(None))
        found = read_frames(path, colour=True)
    if found.response.tone_curve != curve:
        raise RuntimeError(f"read as {found.response.tone_curve}, written as {curve}")
    values = found.frames / (257 if found.frames.dtype == np.uint16 else 1)
    return f"{codec} {depth} bit crf {crf}", np.rint(values).astype(np.uint8)


def figures(frame: Array, truth: Array, periods: Array, camera: Camera) -> Array:
    """PSNR, dB; cast, DN; share of burnt pixels; amplitude of the row means of ln(picture/truth) at the frequencies."""
    values = frame.astype(float)
    scaled = values * (values * truth).sum() / (values**2).sum()
    cast = np.abs(CHROMA @ (scaled - truth).mean(axis=(0, 1))).max()
    light = [linear_light(one.astype(np.uint8), camera) + 0.5 for one in (frame, np.rint(truth))]
    ratio = np.log(light[0] / light[1]).mean(axis=(1, 2))
    turns = 2 * np.pi * np.arange(len(ratio))[:, None] / periods
    design = np.concatenate([np.ones((len(ratio), 1)), np.cos(turns), np.sin(turns)], axis=1)
    terms = np.linalg.lstsq(design, ratio, rcond=None)[0][1:]
    swing = np.hypot(*np.split(terms, 2)).max(initial=0.0)
    return np.array(
        [10 * np.log10(255**2 / ((scaled - truth) ** 2).mean()), cast, (values.max(-1) >= 254).mean(), swing]
    )


def cleaned(camera: Camera, frames: list[Array]) -> tuple[list[Array], int, list[float]]:
    """The frames as `ocisac clean` writes them; how many are unchanged; processor time of each, s."""
    cleaner, done, waiting, unchanged, seconds = VideoCleaner(camera), list(frames), list[int](), 0, list[float]()
    for k, stored in enumerate(frames):
        begun = time.process_time()
        found = cleaner.push(stored[None])
        if found.unchanged[0]:
            waiting.append(k)
        else:
            done[k] = found.frames[0]
            for before in waiting[-WAITING:]:
                again = cleaner.again(frames[before][None], k - before)
                done[before] = again.frames[0]
                unchanged += bool(again.unchanged[0])
            unchanged += len(waiting[:-WAITING])
            waiting.clear()
        seconds.append(round(time.process_time() - begun, 2))
    return done, unchanged + len(waiting), seconds


def measured(seed: int, largest: int, plain: bool = False) -> dict[str, Any]:
    random = np.random.default_rng([seed, 1])
    curve = "srgb" if plain or random.random() < 0.67 else "hlg"
    facts, camera, periods, frames = film(seed, largest, curve)
    stored, truths, lefts = zip(*frames, strict=True)
    code = "none"
    if not plain and random.random() < 0.5:
        code, decoded = coded(np.stack(stored), curve, random)
        stored = tuple(decoded)
    done, unchanged, seconds = cleaned(camera, list(stored))
    changes, behind = [], []
    for one, result, truth, left in zip(stored, done, truths, lefts, strict=True):
        known = stored_values(linear_light(one, camera) / left, camera, BYTES)
        before, after, oracle = (figures(values, truth, periods, camera) for values in (one, result, known))
        changes.append(after - before)
        behind.append((oracle - after)[0])
    gains, cast, burnt, swing = np.array(changes).T
    values = {"least_gain_db": gains.min(), "gain_db": np.median(gains), "behind_db": np.median(behind)}
    values |= {"cast": cast.max(), "burnt": burnt.max(), "swing": swing.max()}
    broken = [k for k, limit in LIMITS.items() if (values[k] < limit if limit < 0 else values[k] > limit)]
    rounded = {key: round(float(value), 4) for key, value in values.items()}
    facts |= {"curve": curve, "coded": code}
    return {**facts, **rounded, "unchanged": unchanged, "seconds": seconds, "broken": broken}


def kinds(found: dict[str, Any]) -> Iterator[str]:
    """All kinds that a scene is of."""
    periods = found["periods"]
    length = max(periods, default=0)
    cycles = "less than a cycle" if length > found["rows"] else "a cycle or more"
    yield "all"
    yield "bands: none" if not periods else "bands: below 128 rows" if length < 128 else f"bands: longer, {cycles}"
    if periods:
        yield f"lamps: {len(periods)}, {'even' if found['is_even'] else 'a part more'}"
    yield f"size: {found['rows']} rows"
    yield f"coded: {found['coded'].split(' crf')[0]}"
    yield f"curve: {found['curve']}"
    yield f"motion: {found['motion']}"


def table(lines: Iterable[str]) -> Iterator[str]:
    """Markdown of the scenes, a row for each kind; behind the true light: of those with bands."""
    of_kind = collections.defaultdict[str, list[dict[str, Any]]](list)
    for found in map(json.loads, lines):
        for kind in kinds(found) if "seed" in found else ():
            of_kind[kind].append(found)
    yield "| kind | scenes | least gain | median | behind | most | unchanged | limits broken |"
    yield "|---|---:|---:|---:|---:|---:|---:|---|"
    for kind, scenes in sorted(of_kind.items()):
        least, gain = min(one["least_gain_db"] for one in scenes), np.median([one["gain_db"] for one in scenes])
        behind = [one["behind_db"] for one in scenes if one["periods"]] or [0.0]
        unchanged = sum(one["unchanged"] for one in scenes) / (FRAMES * len(scenes))
        broken = collections.Counter(limit for one in scenes for limit in one["broken"])
        limits = ", ".join(f"{limit} {count}" for limit, count in broken.items())
        yield (
            f"| {kind} | {len(scenes)} | {least:.1f} | {gain:.1f} | {np.median(behind):.2f} | {max(behind):.1f} "
            f"| {unchanged:.0%} | {limits} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--largest", type=int, default=2160, help="rows of the largest frames")
    parser.add_argument("--plain", action="store_true", help="sRGB, not coded")
    parser.add_argument("--markdown", type=argparse.FileType(), help="JSON lines of scenes, for a table")
    options = parser.parse_args()
    if options.markdown:
        print("\n".join(table(options.markdown)))
        return
    broken: collections.Counter[str] = collections.Counter()
    for seed in range(options.first, options.first + options.count):
        found = measured(seed, options.largest, options.plain)
        broken.update(found["broken"])
        print(json.dumps(found), flush=True)
    print(json.dumps({"scenes": options.count, "broken": dict(broken)}))


if __name__ == "__main__":
    main()
