#!/usr/bin/env python3
"""Accuracy of the removal of bands: simulated scenes and videos with a known clean picture, photographs, recordings.

docs/explanation/cleaning.md says what each option measures. Scenes of 360 x 480 bytes under tones of 8 to 60 rows per
cycle and random chips of 6.2 rows, noise 1.5; PSNR over pixels with at least a tenth of the mean light, compared with
division by the row mean over its smoothed trend (the best of eight lengths) and by the true light and share (oracle).
--slow: peak 255, one gain a colour; oracle: the best gain of each row and colour.
"""

from __future__ import annotations

import argparse
import itertools
import json
import pathlib
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from grounds import add_boxes, add_text, clouds

from ocisac_fast import Camera, Chips, Tone, integrate_exposure, remove_bands
from ocisac_fast.camera.linear_light import linear_light, stored_values
from ocisac_fast.cleaning import Mark, VideoCleaner
from ocisac_fast.files import read_frames, write_frames

ROWS, COLUMNS = 360, 480
CAMERA = Camera(1e-5, exposure=1e-5)
SRGB = Camera(1.0, tone_curve="srgb")
RECORDINGS = ("poster_nlos.jpg", "underwater_0.jpeg", "underwater_2.jpeg")
GROUNDS, LAMPS = ("clouds", "boxes", "text"), ("even", "spot", "part")


def lights() -> dict[str, np.ndarray]:
    """Light of each row, mean 1."""
    bits = np.random.default_rng(5).integers(0, 2, 200).astype(float)
    waves = {f"tone of {n} rows": Tone(1e5 / n, depth=0.9) for n in (8, 20, 60)}
    rows = {name: integrate_exposure(wave, CAMERA, ROWS) for name, wave in waves.items()}
    rows["chips of 6.2 rows"] = integrate_exposure(Chips(bits.tolist(), 1e5 / 6.2), Camera(1e-5, exposure=4e-5), ROWS)
    return {name: light / light.mean() for name, light in rows.items()}


def albedo(kind: str, random: np.random.Generator) -> np.ndarray:
    """Reflectance of the scene."""
    if kind == "clouds":
        return np.clip(0.45 * np.exp(0.35 * clouds(ROWS, COLUMNS, random)), 0.03, 1.0)
    picture = np.full((ROWS, COLUMNS), 0.8 if kind == "text" else 0.4)
    if kind == "boxes":
        add_boxes(picture, random, (8, 120), (0.06, 0.95))
    else:
        add_text(picture, random, 30, 0.12)
    return picture


def lamp(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Steady light, and light of the lamp."""
    y, x = np.mgrid[:ROWS, :COLUMNS]
    if kind == "even":
        return np.full((ROWS, COLUMNS), 60.0), np.full((ROWS, COLUMNS), 84.0)
    if kind == "spot":
        away = (x - 0.45 * COLUMNS) ** 2 + (y - 0.5 * ROWS) ** 2
        return np.full((ROWS, COLUMNS), 50.0), 6 + 90 * np.exp(-away / (2 * (0.3 * COLUMNS) ** 2))
    return np.full((ROWS, COLUMNS), 50.0), 6 + 84 / (1 + np.exp((x + 0.35 * y - 0.65 * COLUMNS) / 1.5))


def scene(light: np.ndarray, ground: str, lamp_kind: str, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stored picture, clean picture, and the light's factor in each pixel."""
    random = np.random.default_rng(seed)
    back = albedo(ground, random)
    steady, modulated = lamp(lamp_kind)
    clean = back * (steady + modulated)
    left = 1 + modulated / (steady + modulated) * (light[:, None] - 1)
    read = clean * left + 1.5 * random.standard_normal(clean.shape)
    return np.clip(np.rint(read), 0, 255).astype(np.uint8), clean, left


def psnr(picture: np.ndarray, truth: np.ndarray, kept: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / np.mean((picture[kept] - truth[kept]) ** 2)))


def smoothed(values: np.ndarray, rows: float) -> np.ndarray:
    if rows <= 0:
        return values
    reach = min(int(4 * rows), len(values) - 1)
    bell = np.exp(-0.5 * (np.arange(-reach, reach + 1) / rows) ** 2)
    return np.convolve(np.pad(values, reach, "reflect"), bell / bell.sum(), "valid")


def by_row_means(stored: np.ndarray) -> list[np.ndarray]:
    mean = stored.mean(axis=1)
    scales = [smoothed(mean, short) / smoothed(mean, long) for short in (0, 1) for long in (10, 20, 40, 80)]
    return [stored / np.maximum(scale, 0.01)[:, None] for scale in scales]


def measured_scene(light: np.ndarray, ground: str, lamp_kind: str, seed: int = 1) -> dict[str, float]:
    stored, clean, left = scene(light, ground, lamp_kind, seed)
    kept = (stored < 255) & (left > 0.1)
    given, found = (remove_bands(stored, CAMERA, light=rows, level="mean").frames for rows in (light, None))
    return {
        "stored": psnr(stored, clean, kept),
        "row_means": max(psnr(plain, clean, kept) for plain in by_row_means(stored)),
        "found": psnr(found, clean, kept),
        "given": psnr(given, clean, kept),
        "oracle": psnr(stored / np.maximum(left, 0.1), clean, kept),
    }


VIDEOS = (  # texture, lamp, rows per cycle, pixels a frame down and right
    ("boxes", "part", 90, (0, 0)),
    ("boxes", "part", 90, (3, 7)),
    ("boxes", "part", 25, (1, 4)),
    ("clouds", "spot", 90, (3, 7)),
    ("boxes", "even", 90, (2, 3)),
)


def video(
    ground: str, kind: str, period: float, speed: tuple[int, int], frames: int, seed: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Stored and clean frames and the light's factor: the camera turns over a scene and its lamp."""
    random, rows, columns = np.random.default_rng(seed), 1080, 1920
    height, width = rows + speed[0] * frames, columns + speed[1] * frames
    picture = np.full((height, width), 0.4)
    for _ in range(150):
        top, left = random.integers(0, height - 20), random.integers(0, width - 20)
        down, right = random.integers(16, rows // 3, 2)
        picture[top : top + down, left : left + right] = random.uniform(0.06, 0.95)
    if ground == "clouds":
        picture = np.clip(0.45 * np.exp(0.35 * clouds(height, width, random)), 0.03, 1.0)
    y, x = np.mgrid[:height, :width]
    away = (x - 0.45 * columns) ** 2 + (y - 0.5 * rows) ** 2
    modulated = {
        "part": 6 + 84 / (1 + np.exp((x + 0.35 * y - 0.65 * columns) / 4)),
        "spot": 6 + 90 * np.exp(-away / (2 * (0.3 * columns) ** 2)),
        "even": np.full(picture.shape, 84.0),
    }[kind]
    for k in range(frames):
        part = np.s_[speed[0] * k : speed[0] * k + rows, speed[1] * k : speed[1] * k + columns]
        light = 1 + 0.9 * np.cos(2 * np.pi * (np.arange(rows) / period + 0.37 * k))
        left = 1 + modulated[part] / (50 + modulated[part]) * (light[:, None] - 1)
        clean = picture[part] * (50 + modulated[part])
        read = clean * left + 1.5 * random.standard_normal(clean.shape)
        yield np.clip(np.rint(read), 0, 255).astype(np.uint8), clean, left


def deflickered(frames: list[np.ndarray]) -> tuple[list[np.ndarray], float]:
    """FFmpeg's deflicker: every frame times one factor, so that the mean brightness stays. Grey frames, or RGB, which
    it gets as luma and chroma; processor time of a frame in the filter alone, s.
    """
    import av

    given, filtered = ("gray", "gray") if frames[0].ndim == 2 else ("rgb24", "yuv444p")
    graph = av.filter.Graph()
    rows, columns = frames[0].shape[:2]
    source = graph.add_buffer(width=columns, height=rows, format=filtered, time_base="1/30")
    steps = [source, graph.add("deflicker", "size=5"), graph.add("buffersink")]
    graph.link_nodes(*steps).configure()
    result, seconds = list[av.VideoFrame](), 0.0
    for k, frame in enumerate([*frames, None]):
        picture = None
        if frame is not None:
            picture = av.VideoFrame.from_ndarray(frame, format=given).reformat(format=filtered)
            picture.pts = k
        begun = time.process_time()
        graph.push(picture)
        while True:
            try:
                result.append(graph.pull())
            except (av.error.BlockingIOError, av.error.EOFError):
                break
        seconds += (time.process_time() - begun) / len(frames)
    return [picture.to_ndarray(format=given) for picture in result], seconds


def measured_video(scene: tuple[Any, ...], frames: int, seed: int) -> dict[str, float]:
    cleaner = VideoCleaner(CAMERA, level="mean")
    stored, seconds, carried, alone, truths = [], [], [], [], []
    for k, (read, clean, left) in enumerate(video(*scene, frames, seed)):
        kept = (read < 255) & (left > 0.1)
        begun = time.process_time()
        picture = cleaner.push(read).frames
        seconds.append(time.process_time() - begun)
        carried.append(psnr(picture, clean, kept))
        if k % 3 == 0:
            alone.append(carried[-1] - psnr(remove_bands(read, CAMERA, level="mean").frames, clean, kept))
        stored.append(read)
        truths.append((clean, kept))
    as_stored, even = (
        np.mean([psnr(picture, *truth) for picture, truth in zip(pictures, truths, strict=True)])
        for pictures in (stored, deflickered(stored)[0])
    )
    return {
        "stored": float(as_stored),
        "deflicker": float(even),
        "carried": float(np.mean(carried)),
        "worst_over_alone": float(min(alone)),
        "mean_over_alone": float(np.mean(alone)),
        "first_s": seconds[0],
        "after_s": float(np.mean(seconds[1:])),
    }


def pooled_depth(picture: np.ndarray, light: np.ndarray, kept: np.ndarray) -> float:
    """Depth of the row light in a picture of linear light: regression of each column of kept pixels on the light, both
    without changes slower than 128 rows; root of the ratio of the columns' energies to those of their means.
    """
    rows = len(light)
    slow = np.cos(np.pi * np.outer((np.arange(rows) + 0.5) / rows, np.arange(1 + 2 * rows // 128)))
    terms = np.concatenate([slow, (light - light.mean())[:, None]], axis=1)
    columns = kept.mean(axis=0) > 0.25
    weight = kept[:, columns].astype(float)
    products = (terms[:, :, None] * terms[:, None, :]).reshape(rows, -1)
    normal = (weight.T @ products).reshape(-1, terms.shape[1], terms.shape[1]) + 1e-6 * np.eye(terms.shape[1])
    values = picture[:, columns] * weight
    followed = np.linalg.solve(normal, (values.T @ terms)[..., None])[:, -1, 0]
    energy = 1 / np.linalg.inv(normal)[:, -1, -1]  # of the light without its slow part
    means = values.sum(axis=0) / weight.sum(axis=0)
    return float(np.sqrt((followed**2 @ energy) / (means**2 @ energy)))


def depth_by_chance(picture: np.ndarray, light: np.ndarray, kept: np.ndarray) -> float:
    """The same for absent lights: shifted copies of this one, which texture resembles by chance."""
    shifts = range(37, len(light) - 36, 53)
    return float(np.sqrt(np.mean([pooled_depth(picture, np.roll(light, k), kept) ** 2 for k in shifts])))


def detail(picture: np.ndarray, rows: np.ndarray) -> float:
    """Energy of the mixed differences of log light over rows and columns, in neighbouring lit rows: texture and noise.
    Bands, equal in both columns, and gains cancel."""
    across = np.diff(np.log(picture + 2.0), axis=1)
    both = rows[1:] & rows[:-1]
    return float(np.mean((across[1:] - across[:-1])[both] ** 2))


def change_of_rows(picture: np.ndarray, before: np.ndarray, kept: np.ndarray, rows: np.ndarray) -> float:
    """Largest relative change of the light of a row."""
    change = (np.abs(picture - before) * kept)[rows].sum(axis=1)
    return float(np.max(change / np.maximum((before * kept)[rows].sum(axis=1), 1e-9)))


def recording(path: pathlib.Path) -> list[dict[str, Any]]:
    """Effect of remove_bands and of vertical blurs of 9, 31 and 101 rows on the colour with the strongest light."""
    stored = read_frames(path).frames
    done = remove_bands(stored, SRGB)
    colour = int(np.argmax(done.share[0].mean(axis=(0, 1)) * stored[0].mean(axis=(0, 1))))
    light = done.light[0, :, colour]
    before, after = (linear_light(frames[0, ..., colour], SRGB) for frames in (stored, done.frames))
    marks, share = done.marks[0, ..., colour], done.share[0, ..., colour]
    kept = (marks == Mark.RESTORED) & (share > 0.5 * share.max())
    bright = np.quantile(light, 0.95)
    pictures = {"remove_bands": after}
    for rows in (9, 31, 101):
        box = np.ones(rows) / rows
        pictures[f"blur of {rows} rows"] = np.apply_along_axis(np.convolve, 0, before, box, "same")
    at_first = pooled_depth(before, light, kept)
    details = detail(before, light > 0.5 * bright)
    result = []
    for name, picture in pictures.items():
        taken = 20 * np.log10(at_first / pooled_depth(picture, light, kept))
        change = change_of_rows(picture, before, kept, light >= 0.98 * bright)
        kept_detail = 10 * np.log10(detail(picture, light > 0.5 * bright) / details)
        result.append(
            {
                "name": name,
                "correlation_taken_db": float(taken),
                "none_left_db": float(20 * np.log10(at_first / depth_by_chance(picture, light, kept))),
                "lit_rows_changed": change,
                "detail_db": float(kept_detail),
                "too_dark": float((marks == Mark.DARK).mean()),
                "passes": bool(taken >= 20 and change < 0.03 and abs(kept_detail) <= 1),
            }
        )
    return result


def mains(folder: pathlib.Path) -> dict[str, float]:
    """PSNR to the truth, peak 255, of a picture under mains light, stored and cleaned; and with the best gain for each
    row and colour, which knows the truth.
    """
    stored = read_frames(folder / "mains_flicker.png").frames[0]
    truth = read_frames(folder / "mains_flicker_truth.png").frames[0]
    cleaned = remove_bands(stored[None], SRGB).frames[0]
    told = {"stored": (stored, (0, 1)), "cleaned": (cleaned, (0, 1)), "oracle": (stored, (1,))}
    return {name: fitted_psnr(picture, truth, axis) for name, (picture, axis) in told.items()}


SLOW_CYCLES, SLOW_DEPTHS = (1.0, 1.5, 2.2, 3.5), (0.1, 0.25, 0.5)
MAX_SIDE = 640  # pixels of a photograph, reduced


def photographs(folder: pathlib.Path) -> Iterator[npt.NDArray[np.float64]]:
    """Linear light of each photograph (rows, columns, colours), and on its side."""
    for path in sorted(folder.iterdir()):
        light = linear_light(read_frames(path).frames[0], SRGB)
        every = -(-max(light.shape) // MAX_SIDE)
        rows, columns = light.shape[0] // every, light.shape[1] // every
        light = light[: rows * every, : columns * every].reshape(rows, every, columns, every, -1).mean(axis=(1, 3))
        yield light
        yield light.transpose(1, 0, 2)


def under_mains(light: np.ndarray, cycles: float, depth: float, phase: float) -> tuple[np.ndarray, np.ndarray]:
    """Stored bytes of a photograph under mains light, and those under a steady one."""
    angle = 2 * np.pi * cycles * (np.arange(len(light)) + 0.5) / len(light) + phase
    waves = 1 + depth * np.cos(angle) + 0.2 * depth * np.cos(2 * angle)
    dimmed = light / (1 + 1.2 * depth)
    kind = np.dtype(np.uint8)
    return stored_values(dimmed * waves[:, None, None], SRGB, kind), stored_values(dimmed, SRGB, kind)


def fitted_psnr(stored: np.ndarray, truth: np.ndarray, axis: tuple[int, ...]) -> float:
    """PSNR after the best gain over these axes, peak 255, at most 60 dB."""
    values, truth = stored.astype(float), truth.astype(float)
    gain = (values * truth).sum(axis=axis, keepdims=True) / np.maximum((values**2).sum(axis=axis, keepdims=True), 1e-9)
    return min(psnr(gain * values, truth, np.ones(truth.shape, bool)), 60.0)


def slow_bands(folder: pathlib.Path, seed: int) -> Iterator[dict[str, float]]:
    """Photographs under each depth and number of cycles, and without bands."""
    lights, random = list(photographs(folder)), np.random.default_rng(seed)
    for depth, cycles in ((0.0, 0.0), *((depth, cycles) for depth in SLOW_DEPTHS for cycles in SLOW_CYCLES)):
        found = []
        for light in lights:
            stored, truth = under_mains(light, cycles, depth, random.uniform(0, 2 * np.pi))
            done = remove_bands(stored[None], SRGB)
            if not done.unchanged[0]:
                plain, cleaned = (fitted_psnr(one, truth, (0, 1)) for one in (stored, done.frames[0]))
                found.append((plain, cleaned, fitted_psnr(stored, truth, (1,))))
        values = np.array(found) if found else np.full((1, 3), np.nan)
        yield {
            "depth": depth,
            "cycles": cycles,
            "photographs": len(lights),
            "cleaned": len(found),
            "worse_by_half_a_db": int((values[:, 1] < values[:, 0] - 0.5).sum()),
            **dict(zip(("stored_db", "cleaned_db", "oracle_db"), values.mean(axis=0).tolist(), strict=True)),
        }


def means(scenes: list[dict[str, float]]) -> dict[str, float]:
    return {key: float(np.mean([one[key] for one in scenes])) for key in scenes[0]}


def rounded(values: dict[str, float]) -> dict[str, float]:
    return {key: round(value, 2) for key, value in values.items()}


def draw(path: str) -> None:
    """Draw scenes side by side: stored, by row means, remove_bands, clean."""
    rows = []
    for name, ground, kind in (
        ("tone of 20 rows", "boxes", "part"),
        ("chips of 6.2 rows", "clouds", "spot"),
        ("tone of 8 rows", "text", "part"),
    ):
        stored, clean, left = scene(lights()[name], ground, kind)
        kept = (stored < 255) & (left > 0.1)
        plain = max(by_row_means(stored), key=lambda picture: psnr(picture, clean, kept))
        found = remove_bands(stored, CAMERA, light=lights()[name], level="mean").frames
        rows.append(np.concatenate([stored, plain, found, clean], axis=1))
    write_frames(path, np.clip(1.6 * np.concatenate(rows), 0, 255).astype(np.uint8)[None])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=pathlib.Path)
    parser.add_argument("--slow", type=pathlib.Path, help="photographs under slow bands alone")
    parser.add_argument("--picture")
    parser.add_argument("--video", action="store_true", help="videos alone")
    parser.add_argument("--frames", type=int, default=18, help="of each video")
    parser.add_argument("--quick", action="store_true", help="boxes alone")
    parser.add_argument("--each", action="store_true", help="print dB below the oracle for every scene")
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=[1], help="seeds of texture and noise; results are averaged"
    )
    options = parser.parse_args()
    if options.video:
        for one in VIDEOS:
            found = [measured_video(one, options.frames, seed) for seed in options.seeds]
            values = {**means(found), "worst_over_alone": min(each["worst_over_alone"] for each in found)}
            print(json.dumps({"video": one, **{key: round(value, 3) for key, value in values.items()}}), flush=True)
        return
    if options.slow:
        for seed in options.seeds:
            for values in slow_bands(options.slow, seed):
                print(json.dumps({key: round(value, 2) for key, value in values.items()}), flush=True)
        return
    for name, light in lights().items():
        scenes = []
        for ground, kind in itertools.product(GROUNDS[1:2] if options.quick else GROUNDS, LAMPS):
            scenes += [measured_scene(light, ground, kind, seed) for seed in options.seeds]
            if options.each:
                own = scenes[-len(options.seeds) :]
                behind = means([{key: one["oracle"] - one[key] for key in ("given", "found")} for one in own])
                print(f"{name}, {ground}, {kind}: dB behind the oracle", rounded(behind))
        print(name, rounded(means(scenes)))
    if options.recordings:
        for name in RECORDINGS:
            for values in recording(options.recordings / name):
                print(name, values)
        print("mains_flicker.png", rounded(mains(options.recordings)))
    if options.picture:
        draw(options.picture)


if __name__ == "__main__":
    main()
