#!/usr/bin/env python3
"""Random scenes under zero to two lamps, as films of a few frames, cleaned as `ocisac clean` does: it must never harm.

`film` and `measured` draw them. For each scene, over its frames: the least and the median gain
of PSNR to the scene without bands (peak 255, one gain for all colours), that of the least frame of the file, coded
again at crf 10, how far it is behind that of the true light divided out, the largest growth of the cast (DN), of the
share of burnt pixels (254 or more) and of the amplitude of the row means of ln(picture/truth) along the lights' waves;
and which limit is broken. --markdown: no scenes are made; a table of those whose lines are in a file.

A scene whose bands are longer than the frame cannot be told apart where an oracle makes one of the first three frames
worse: these are all that is known when they leave. The oracle knows the lights' frequencies and shares, what moves in
the scene and how large its shades of each size are, and fits the lights' waves to the means of rows.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import json
import pathlib
import tempfile
import time
from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import Any

import av
import numpy as np
import numpy.typing as npt
from grounds import clouds

from ocisac_fast import Camera
from ocisac_fast.camera.linear_light import linear_light, stored_values
from ocisac_fast.cleaning import VideoCleaner
from ocisac_fast.files import read_frames
from ocisac_fast.files.video_writing import USUAL_CRF

Array = npt.NDArray[Any]
SIZES = ((480, 640), (600, 800), (720, 1280), (1080, 1440), (1080, 1920), (2160, 3840))
FRAMES, FRAME_TIME, BYTES = 6, 1 / 30, np.dtype(np.uint8)
WAITING = 3  # unchanged frames that `ocisac clean` holds
TRANSFERS = {"srgb": 13, "hlg": 18}  # numbers of ITU-T H.273
CHROMA = np.array([[-0.1146, -0.3854, 0.5], [0.5, -0.4542, -0.0458]])  # BT.709
LIMITS = {"least_gain_db": -0.1, "file_db": -0.5, "cast": 1.0, "burnt": 0.002, "swing": 1e-3, "behind_db": 1.5}

SHADES = np.arange(1, 25)  # half cycles in the frame of the texture that an oracle knows the size of
ROW_ERROR = 0.01  # of the logarithm of a row's mean
KNOWN_FRAMES = 3


@dataclasses.dataclass
class Lit:
    """A stored frame, the scene without bands, the light's share of the pixels, and the waves of the lamps."""

    stored: Array
    truth: Array
    share: Array
    waves: Array  # (rows, two for each lamp), of unit amplitude

    def light(self, terms: Array) -> Array:
        return np.maximum(1 + self.share * (self.waves @ terms)[:, None], 0.02)[..., None]


@dataclasses.dataclass
class Coding:
    codec: str
    depth: int
    crf: float


def reflectance(rows: int, columns: int, random: np.random.Generator) -> Array:
    """(rows, columns, 3) of a room: clouds, shades, a vignette, a table's edge, boxes, lines of text."""
    picture = np.broadcast_to(random.uniform(0.25, 0.7, 3), (rows, columns, 3)).copy()
    if random.random() < 0.5:
        picture *= np.exp(random.uniform(0.1, 0.35) * clouds(rows, columns, random))[..., None]
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


def film(seed: int, largest: int, curve: str) -> tuple[dict[str, Any], Camera, Array, list[Lit]]:
    """Facts of the scene; the camera; the terms of the lamps' waves; the frames."""
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
    terms = np.concatenate([depths * np.sin(phases), depths * np.cos(phases)])
    frames = []
    for k, (down, right) in enumerate(ways):
        turns = 2 * np.pi * (np.arange(rows)[:, None] + k * FRAME_TIME / camera.row_period) / periods
        part = np.s_[down : down + rows, right : right + columns]
        truth = stored_values(picture[part], camera, BYTES).astype(float)
        lit = Lit(truth, truth, share[part], np.concatenate([np.cos(turns), np.sin(turns)], axis=1))
        read = stored_values(picture[part] * lit.light(terms), camera, BYTES) + random.normal(0, 1.5, truth.shape)
        lit.stored = np.clip(np.rint(read), 0, 255).astype(np.uint8)
        frames.append(lit)
    steps = np.remainder(FRAME_TIME / camera.row_period / periods + 0.5, 1) - 0.5
    facts = {"seed": seed, "rows": rows, "periods": periods.round().tolist(), "steps": steps.round(3).tolist()}
    facts |= {"depths": depths.round(2).tolist(), "motion": motion, "is_even": is_even}
    return facts, camera, terms, frames


def coded(frames: Array, curve: str, coding: Coding) -> Array:
    """Encode frames (frames, rows, columns, colours) and decode them to 8 bits."""
    pixels = "yuv420p" if coding.depth == 8 else "yuv420p10le"
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "film.mp4"
        with av.open(str(path), "w") as container:
            options = {"crf": str(coding.crf), "preset": "veryfast", "x265-params": "log-level=none"}
            stream = container.add_stream(
                coding.codec, rate=Fraction(1 / FRAME_TIME).limit_denominator(), options=options
            )
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
    return np.rint(values).astype(np.uint8)


def scaled_to(truth: Array, frame: Array) -> Array:
    values = frame.astype(float)
    return values * (values * truth).sum() / (values**2).sum()


def decibels(frame: Array, truth: Array) -> float:
    """PSNR with one gain for all colours."""
    return float(10 * np.log10(255**2 / ((scaled_to(truth, frame) - truth) ** 2).mean()))


def row_means(frame: Array, camera: Camera) -> Array:
    """Means over a row of the logarithm of light."""
    logarithms = np.log(linear_light(np.arange(256, dtype=np.uint8), camera) + 0.5)
    return logarithms[np.rint(frame).astype(np.uint8)].mean(axis=(1, 2))


def figures(frame: Array, lit: Lit, camera: Camera) -> Array:
    """PSNR, dB; cast, DN; share of burnt pixels; amplitude of the row means of ln(picture/truth) along the waves.

    That of all waves together: lamps less than a cycle of the frame apart have no amplitudes of their own in it.
    """
    cast = np.abs(CHROMA @ (scaled_to(lit.truth, frame) - lit.truth).mean(axis=(0, 1))).max()
    ratio = row_means(frame, camera) - row_means(lit.truth, camera)
    waves = lit.waves - lit.waves.mean(axis=0)
    along = waves @ np.linalg.lstsq(waves, ratio - ratio.mean(), rcond=None)[0]
    return np.array([decibels(frame, lit.truth), cast, (frame.max(-1) >= 254).mean(), np.sqrt(2 * (along**2).mean())])


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


def without(lit: Lit, terms: Array, camera: Camera) -> Array:
    """The frame divided by a light."""
    return stored_values(linear_light(lit.stored, camera) / lit.light(terms), camera, BYTES)


def known_terms(frames: list[Lit], camera: Camera) -> Array:
    """Terms of the waves by least squares; known: their frequencies, shares, what moves, how large the shades are."""
    truths = [row_means(lit.truth, camera) for lit in frames]
    texture = np.mean(truths, axis=0)
    place = (np.arange(len(texture)) + 0.5) / len(texture)
    shades = np.cos(np.pi * place[:, None] * SHADES)
    fall = SHADES**-1.5  # of the shades of photographs
    sizes = fall * np.sqrt((((2 / len(place)) * shades.T @ (texture - texture.mean()) / fall) ** 2).mean())
    lights = [lit.share.mean(axis=1)[:, None] * lit.waves for lit in frames]
    design = np.concatenate([np.column_stack([np.ones_like(place), shades, light]) for light in lights]) / ROW_ERROR
    seen = [row_means(lit.stored, camera) - truth + texture for lit, truth in zip(frames, truths, strict=True)]
    expected = np.zeros((len(sizes), design.shape[1]))
    expected[:, 1 : 1 + len(sizes)] = np.diag(1 / sizes)
    target = np.concatenate([np.concatenate(seen) / ROW_ERROR, np.zeros(len(sizes))])
    return np.linalg.lstsq(np.concatenate([design, expected]), target, rcond=None)[0][1 + len(sizes) :]


def known_gain(frames: list[Lit], camera: Camera) -> float:
    """Least gain of PSNR, dB, of the first frames by an oracle that sees no others."""
    first = frames[:KNOWN_FRAMES]
    terms = known_terms(first, camera)
    return min(decibels(without(lit, terms, camera), lit.truth) - decibels(lit.stored, lit.truth) for lit in first)


def measured(seed: int, largest: int, plain: bool = False) -> dict[str, Any]:
    random = np.random.default_rng([seed, 1])
    curve = "srgb" if plain or random.random() < 0.67 else "hlg"
    facts, camera, terms, frames = film(seed, largest, curve)
    coding = None
    if not plain and random.random() < 0.5:
        codec, depth = ("libx264", "libx265")[random.integers(2)], (8, 10)[random.integers(2)]
        coding = Coding(codec, depth, int(random.integers(18, 29)))
        for lit, decoded in zip(frames, coded(np.stack([lit.stored for lit in frames]), curve, coding), strict=True):
            lit.stored = decoded
    done, unchanged, seconds = cleaned(camera, [lit.stored for lit in frames])
    changes, behind = [], []
    for lit, result in zip(frames, done, strict=True):
        before = figures(lit.stored, lit, camera)
        after = before if result is lit.stored else figures(result, lit, camera)
        changes.append(after - before)
        behind.append(decibels(without(lit, terms, camera), lit.truth) - after[0])
    gains, cast, burnt, swing = np.array(changes).T
    values = {"least_gain_db": gains.min(), "gain_db": np.median(gains), "behind_db": np.median(behind)}
    values |= {"cast": cast.max(), "burnt": burnt.max(), "swing": swing.max()}
    values["file_db"] = 0.0
    if coding and unchanged < FRAMES:
        written = coded(np.stack(done), curve, dataclasses.replace(coding, crf=USUAL_CRF))
        pairs = zip(frames, written, strict=True)
        values["file_db"] = min(decibels(one, lit.truth) - decibels(lit.stored, lit.truth) for lit, one in pairs)
    if max(facts["periods"], default=0) > facts["rows"]:
        values["oracle_db"] = known_gain(frames, camera)
    broken = [k for k, limit in LIMITS.items() if (values[k] < limit if limit < 0 else values[k] > limit)]
    rounded = {key: round(float(value), 4) for key, value in values.items()}
    facts |= {"curve": curve, "coded": f"{coding.codec} {coding.depth} bit crf {coding.crf}" if coding else "none"}
    return {**facts, **rounded, "unchanged": unchanged, "seconds": seconds, "broken": broken}


def is_left_out(found: dict[str, Any]) -> bool:
    """Nobody could have known the light in the first frames."""
    return bool(found.get("oracle_db", 0.0) < LIMITS["least_gain_db"])


def kinds(found: dict[str, Any]) -> Iterator[str]:
    """All kinds that a scene is of."""
    periods = found["periods"]
    length = max(periods, default=0)
    cycles = "less than a cycle" if length > found["rows"] else "a cycle or more"
    if is_left_out(found):
        yield "left out: not to be told apart"
        return
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
    left_out = 0
    for seed in range(options.first, options.first + options.count):
        found = measured(seed, options.largest, options.plain)
        left_out += is_left_out(found)
        broken.update([] if is_left_out(found) else found["broken"])
        print(json.dumps(found), flush=True)
    print(json.dumps({"scenes": options.count, "left_out": left_out, "broken": dict(broken)}))


if __name__ == "__main__":
    main()
