"""Simulated scenes with lights, and detection statistics, for sensing.py.

Scenes of 720x960 bytes contain 0 to 20 lights (disks, tones and square waves, each of its own frequency) over clouds,
boxes and lines of text, or over a uniform ground. A light is detected if a separate box is within half a box of it and
the frequency within 3 %; every other box that is not marked as a reflection is false.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from grounds import add_boxes, add_text, clouds

from ocisac_fast import Camera, Chips, SquareWave, Tone, Waveform, detect_sources, integrate_exposure
from ocisac_fast.lights import LightSource
from ocisac_fast.packets import encode_line_code
from ocisac_fast.plots import BLUE, ORANGE, SKY, picture

ROWS, COLUMNS, ROW_TIME = 720, 960, 1e-5
CAMERA = Camera(ROW_TIME, exposure=2e-5)
GROUNDS = ("even", "clouds", "boxes", "text")


def ground(kind: str, random: np.random.Generator) -> np.ndarray:
    """A static picture, (rows, columns), stored values."""
    if kind == "clouds":
        return 60.0 + 15.0 * clouds(ROWS, COLUMNS, random, 1.0)
    picture = np.full((ROWS, COLUMNS), 50.0)
    if kind == "boxes":
        add_boxes(picture, random, (10, 150), (10, 110))
    if kind == "text":
        add_text(picture, random, int(random.integers(26, 40)), 10.0)
    return picture


def scene(random: np.random.Generator, lights: int, kind: str) -> tuple[np.ndarray, list[dict[str, float]], float]:
    """Bytes; the truth: row, column, size, frequency, cycles, ratio of amplitude to noise; and the noise."""
    noise = float(np.exp(random.uniform(np.log(1.0), np.log(8.0))))
    picture = ground(kind, random)
    y, x = np.ogrid[:ROWS, :COLUMNS]
    truth: list[dict[str, float]] = []
    frequencies = random.permutation(np.geomspace(5e3, 2.5e4, 40))
    while len(truth) < lights:
        size = float(np.exp(random.uniform(np.log(30.0), np.log(140.0))))
        row, column = random.uniform(size, ROWS - size), random.uniform(size, COLUMNS - size)
        if any(np.hypot(row - t["row"], column - t["column"]) < size / 2 + t["size"] / 2 + 12 for t in truth):
            size = 30.0
            if any(np.hypot(row - t["row"], column - t["column"]) < size / 2 + t["size"] / 2 + 12 for t in truth):
                continue
        frequency = float(frequencies[len(truth)])
        swing = float(np.exp(random.uniform(np.log(8.0), np.log(120.0))))
        wave = Tone(frequency) if random.random() < 0.5 else SquareWave(frequency)
        light = integrate_exposure(wave, CAMERA, ROWS, start=random.random() / frequency)
        inside = (y - row) ** 2 + (x - column) ** 2 < (size / 2) ** 2
        picture = np.where(inside, 20.0 + swing * light[:, None], picture)
        cycles = size * frequency * ROW_TIME
        place = {"row": row, "column": column, "size": size, "frequency": frequency}
        truth.append({**place, "cycles": cycles, "ratio": swing / 2 / noise})
    stored = np.clip(np.rint(picture + noise * random.standard_normal(picture.shape)), 0, 255).astype(np.uint8)
    return stored, truth, noise


CODES: dict[str, str | tuple[str, ...]] = {
    "NRZ": "none",
    "Manchester": "manchester",
    "4-PPM": ("1000", "0100", "0010", "0001"),
}


def data_scene(random: np.random.Generator, code: str, kind: str) -> tuple[np.ndarray, dict[str, float]]:
    """Bytes with one light that sends random bits, or a tone with one cycle per two chips of Manchester code; and its
    position."""
    noise = float(np.exp(random.uniform(np.log(1.0), np.log(4.0))))
    size = float(np.exp(random.uniform(np.log(80.0), np.log(400.0))))
    rows_per_chip = float(np.exp(random.uniform(np.log(3.0), np.log(min(size / 16.0, 12.0)))))
    swing = float(np.exp(random.uniform(np.log(20.0), np.log(120.0))))
    row, column = random.uniform(size / 2, ROWS - size / 2), random.uniform(size / 2, COLUMNS - size / 2)
    chip = rows_per_chip * ROW_TIME
    if code == "tone":
        wave: Waveform = SquareWave(0.5 / chip, phase=random.uniform(0, 2 * np.pi))
    else:
        chips = encode_line_code(random.integers(0, 2, 1024), CODES[code])
        wave = Chips(chips.astype(float).tolist(), 1 / chip)
    light = integrate_exposure(wave, CAMERA, ROWS, start=20 * chip)
    y, x = np.ogrid[:ROWS, :COLUMNS]
    inside = (y - row) ** 2 + (x - column) ** 2 < (size / 2) ** 2
    picture = np.where(inside, 20.0 + swing * light[:, None], ground(kind, random))
    stored = np.clip(np.rint(picture + noise * random.standard_normal(picture.shape)), 0, 255).astype(np.uint8)
    return stored, {"row": row, "column": column, "size": size, "chip": rows_per_chip, "ratio": swing / 2 / noise}


def _is_within(source: LightSource, light: dict[str, float], height: float, width: float | None = None) -> bool:
    """True if a box has its middle in a region about the light's, square without a width."""
    down, across = source.y + source.height / 2 - light["row"], source.x + source.width / 2 - light["column"]
    return abs(down) < height / 2 and abs(across) < (height if width is None else width) / 2


def _is_light(source: LightSource, light: dict[str, float], height: float, width: float | None = None) -> bool:
    return _is_within(source, light, height, width) and abs(source.frequency / light["frequency"] - 1) < 0.03


def data_lights(count: int) -> dict[str, tuple[float, float]]:
    """By code: share of the lights that are detected (a box at their middle, at least half as high), and other boxes
    a picture."""
    result = {}
    for code in ("tone", *CODES):
        found = others = 0
        for seed in range(count):
            random = np.random.default_rng(40_000 + seed)
            frame, light = data_scene(random, code, GROUNDS[seed % len(GROUNDS)])
            boxes = [s for s in detect_sources(frame, CAMERA) if s.reflection_of is None]
            own = any(_is_within(s, light, light["size"] / 2) and s.height >= light["size"] / 2 for s in boxes)
            found += own
            others += len(boxes) - own
        result[code] = found / count, others / count
    return result


def neighbours_scene(random: np.random.Generator) -> tuple[np.ndarray, list[dict[str, float]]]:
    """Bytes with two lamps on the same rows, 4 to 100 columns apart, whose frequencies are in a ratio of 1.15 to 2.5.

    Rectangles or ellipses of 5 cycles of the slower one or more, up to 700 rows, and of 25 to 100 columns; its cycles
    have 25 to 60 rows.
    """
    noise = random.uniform(1.0, 3.0)
    picture = np.full((ROWS, COLUMNS), random.uniform(20.0, 60.0))
    period = float(np.exp(random.uniform(np.log(25.0), np.log(60.0))))  # rows
    height = float(np.exp(random.uniform(np.log(5.0 * period), np.log(700.0))))
    ratio = float(np.exp(random.uniform(np.log(1.15), np.log(2.5))))
    frequencies = random.permutation([1.0, ratio]) / (period * ROW_TIME)
    row = random.uniform(height / 2, ROWS - height / 2)
    left = random.uniform(0.0, 600.0)
    y, x = np.ogrid[:ROWS, :COLUMNS]
    truth: list[dict[str, float]] = []
    for frequency in frequencies:
        width = float(np.exp(random.uniform(np.log(25.0), np.log(100.0))))
        wave = Tone(frequency) if random.random() < 0.5 else SquareWave(frequency)
        light = integrate_exposure(wave, CAMERA, ROWS, start=random.random() / frequency)
        away = 2 * np.abs(y - row) / height, 2 * np.abs(x - left - width / 2) / width
        inside = np.maximum(*away) < 1 if random.random() < 0.5 else np.hypot(*away) < 1
        picture = np.where(inside, 20.0 + random.uniform(40.0, 150.0) * light[:, None], picture)
        truth.append({"row": row, "column": left + width / 2, "width": width, "height": height, "frequency": frequency})
        left += width + random.uniform(4.0, 100.0)
    stored = np.clip(np.rint(picture + noise * random.standard_normal(picture.shape)), 0, 255).astype(np.uint8)
    return stored, truth


def neighbours(count: int) -> tuple[float, float]:
    """Share of scenes with two lamps on the same rows in which both are found; other boxes a picture."""
    both = others = 0
    for seed in range(count):
        frame, truth = neighbours_scene(np.random.default_rng(50_000 + seed))
        found = [s for s in detect_sources(frame, CAMERA) if s.reflection_of is None]
        hits = sum(any(_is_light(s, light, light["height"], light["width"]) for s in found) for light in truth)
        others += len(found) - hits
        both += hits == 2
    return both / count, others / count


def judge(found: list[LightSource], truth: list[dict[str, float]]) -> tuple[list[bool], list[bool]]:
    """True for each detected light; true for each detection, without reflections, that is a light."""
    rest = [s for s in found if s.reflection_of is None]
    hits, true = [], [False] * len(rest)
    for light in truth:
        near = [k for k, s in enumerate(rest) if not true[k] and _is_light(s, light, light["size"])]
        hits.append(bool(near))
        if near:
            true[near[0]] = True
    return hits, true


def findings(count: int) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Every light of all scenes, with detected or not; every detection, with true or not, size, cycles and ratio as
    measured."""
    lights, boxes = [], []
    for seed in range(count):
        random = np.random.default_rng(seed)
        frame, truth, noise = scene(random, int(random.integers(0, 21)), GROUNDS[seed % len(GROUNDS)])
        found = [s for s in detect_sources(frame, CAMERA) if s.reflection_of is None]
        hits, true = judge(found, truth)
        lights += [{**light, "found": hit} for light, hit in zip(truth, hits, strict=True)]
        for s, one in zip(found, true, strict=True):
            cycles = s.height * s.frequency * ROW_TIME
            boxes.append({"size": s.height, "cycles": cycles, "ratio": s.amplitude / noise, "true": one})
    return lights, boxes


def false_lights(frames: int, rates: tuple[float, ...] = (1.0, 0.1, 0.02, 0.01)) -> dict[float, dict[str, float]]:
    """False lights per picture, on noise and on the grounds without lights, for the given rates."""
    result: dict[float, dict[str, float]] = {rate: {} for rate in rates}
    for kind in ("noise", *GROUNDS[1:]):
        counts = dict.fromkeys(rates, 0)
        for seed in range(frames):
            random = np.random.default_rng(20_000 + seed)  # not the seeds used for tuning
            if kind == "noise":
                frame = np.clip(np.rint(100 + 8 * random.standard_normal((ROWS, COLUMNS))), 0, 255).astype(np.uint8)
            else:
                frame, _, _ = scene(random, 0, kind)
            for rate in rates:
                counts[rate] += len(detect_sources(frame, CAMERA, false_alarms=rate))
        for rate in rates:
            result[rate][kind] = counts[rate] / frames
    return result


BINS = {
    "size": (30, 40, 55, 75, 100, 140),
    "cycles": (1.5, 3, 4, 5, 7, 10, 35),
    "ratio": (0.5, 1, 2, 4, 8, 16, 60),
}
LEAST = {"size": 40, "cycles": 5, "ratio": 2}
Bins = dict[str, list[tuple[float, float, float, int]]]


def shares(entries: list[dict[str, Any]], what: str, least: dict[str, float] | None = None) -> Bins:
    """For each measure: bin, share of its entries that are ``what``, their number; lower bounds for other measures."""
    result: Bins = {}
    for name, edges in BINS.items():
        others = {other: value for other, value in (least or {}).items() if other != name}
        kept = [entry for entry in entries if all(entry[other] >= value for other, value in others.items())]
        rows = []
        for low, high in itertools.pairwise(edges):
            inside = [entry[what] for entry in kept if low <= entry[name] < high]
            rows.append((float(low), float(high), float(np.mean(inside)) if inside else float("nan"), len(inside)))
        result[name] = rows
    return result


def draw(path: str, recall: Bins, precision: Bins) -> None:
    """Draw a scene with its boxes, and recall and precision over the three measures."""
    from matplotlib.patches import Rectangle

    labels = {"size": "height, rows", "cycles": "cycles in it", "ratio": "amplitude / noise of a pixel"}
    with picture(path, 15, 4) as figure:
        shown, *panels = figure.subplots(1, 4, width_ratios=(1.7, 1, 1, 1))
        frame, truth, _ = scene(np.random.default_rng(8), 12, "boxes")
        found = detect_sources(frame, CAMERA)
        shown.imshow(frame, cmap="gray")
        for source in found:
            colour = ORANGE if source.reflection_of is None else SKY
            shown.add_patch(Rectangle((source.x, source.y), source.width, source.height, fill=False, ec=colour))
        shown.set_title(f"{len(truth)} lights among boxes, {len(found)} found")
        shown.set_axis_off()
        for panel, name in zip(panels, BINS, strict=True):
            middle = [np.sqrt(low * high) for low, high, _, _ in recall[name]]
            for bins, label, marker, colour in (
                (precision, "precision", "s--", ORANGE),
                (recall, "recall", "o-", BLUE),
            ):
                panel.plot(middle, [share for _, _, share, _ in bins[name]], marker, color=colour, label=label)
            for x, (_, _, share, number) in zip(middle, recall[name], strict=True):
                panel.annotate(f"{number}", (x, share), (0, -14), textcoords="offset points", ha="center", fontsize=7)
            panel.set(xscale="log", xlabel=labels[name], ylim=(-0.05, 1.05))
            panel.xaxis.set_major_formatter("{x:g}")
            panel.xaxis.set_minor_formatter("")
        panels[0].legend(loc="lower right")
