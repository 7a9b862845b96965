#!/usr/bin/env python3
"""Fit of the probability that a detected tone or waveform is a light, and its calibration.

Pictures: grounds of light_scenes.py and crops of photographs in both directions, half of them with lamps of 2.5 cycles
and more put onto them; one in eleven is a scene of light_scenes.py; and whole photographs, each without lamps and with
some. Photographs that photographs.KEPT_OUT names are left out. --write writes the coefficients to
cpp/src/lights/light_model.hpp; the odds required of a light follow from its false ones in photographs without lamps,
by fits to the other folds, which have other photographs. Calibration is printed of these fits.
"""

from __future__ import annotations

import argparse
import pathlib
from collections.abc import Iterator
from dataclasses import dataclass

import light_scenes
import numpy as np
import photographs

from ocisac_fast import Chips, SquareWave, Tone, Waveform, _core, integrate_exposure
from ocisac_fast.packets import encode_line_code

MODEL = pathlib.Path(__file__).parents[1] / "cpp/src/lights/light_model.hpp"
NARROW = 200  # columns of a frame that a light fills
BENCH_SCENES = 11  # every one of these is a scene of light_scenes.py
SAME_FREQUENCY = 0.03  # relative, as of light_scenes.judge
FOLDS = 6  # of pictures; each has photographs of its own
MOST_LIGHTS = 7  # of scene()
SPOT = 0.75  # reach of a lamp's light around its centre, relative to its size

Lamps = list[dict[str, float]]
Picture = tuple[np.ndarray, Lamps, int, bool]  # bytes, truth, fold, and whether it is a whole photograph without lamps


@dataclass(frozen=True)
class Candidates:
    """Terms (candidates, terms), 1 for lights, and the fold of each candidate's picture."""

    terms: np.ndarray
    light: np.ndarray
    fold: np.ndarray
    plain: np.ndarray  # True in a whole photograph without lamps
    odds: np.ndarray  # by which those of the model are multiplied


def wave_of(random: np.random.Generator, frequency: float, data: bool) -> Waveform:
    """A tone, a square wave, or random data whose Manchester chips have twice the frequency."""
    if data:
        code = light_scenes.CODES[str(random.choice(list(light_scenes.CODES)))]
        chips = encode_line_code(random.integers(0, 2, 1024), code)
        return Chips(chips.astype(float).tolist(), 2 * frequency)
    return Tone(frequency) if random.random() < 0.3 else SquareWave(frequency)


def lamp(random: np.random.Generator, picture: np.ndarray, data: bool) -> dict[str, float]:
    """Add a lamp to a picture: a disk, a soft spot, or the light of one on what lies there; its truth."""
    rows, columns = picture.shape
    size = float(np.exp(random.uniform(np.log(80.0 if data else 30.0), np.log(rows / (1.5 if data else 3)))))
    cycles = float(np.exp(random.uniform(np.log(6.0 if data else 2.5), np.log(size / 4))))
    frequency = cycles / size / light_scenes.ROW_TIME
    row, column = random.uniform(size / 2, rows - size / 2), random.uniform(0.5, max(columns - size, 0.5)) + size / 2
    wave = wave_of(random, frequency, data)
    start = random.uniform(20, 40) / frequency
    light = integrate_exposure(wave, light_scenes.CAMERA, rows, start=start)[:, None]
    y, x = np.ogrid[:rows, :columns]
    away = np.hypot(y - row, x - column) / (size / 2)
    kind = 3 if columns < NARROW or random.random() < 0.02 else random.integers(0, 3)
    swing = float(np.exp(random.uniform(np.log(15.0), np.log(200.0))))
    if kind == 0:
        picture[:] = np.where(away < 1, 15.0 + swing * light, picture)
    elif kind == 1:
        picture += swing * light * np.exp(-1.5 * away**2)
    else:
        picture *= np.where((away < 1) | (kind == 3), 1.0 + swing / 80.0 * light, 1.0)
    if kind == 3:  # all that the camera sees
        return {
            "row": rows / 2,
            "column": columns / 2,
            "size": max(rows, columns),
            "frequency": frequency,
            "cycles": cycles * rows / size,
        }
    return {"row": row, "column": column, "size": size, "frequency": frequency, "cycles": cycles}


def crop(random: np.random.Generator, photo: np.ndarray) -> np.ndarray:
    """A part of a photograph of up to 720 x 960, turned, mirrored, and at another size and contrast."""
    photo = photo.T if random.random() < 0.5 else photo
    photo = photo[:: random.choice([-1, 1]), :: random.choice([-1, 1])]
    scale = float(np.exp(random.uniform(np.log(0.6), np.log(2.0)))) * max(1.0, 300.0 / min(photo.shape))
    size = [min(int(n * scale), most) for n, most in zip(photo.shape, (720, 960), strict=True)]
    for axis, n in enumerate(size):
        start = random.uniform(0.0, max(photo.shape[axis] - 1 - (n - 1) / scale, 0.0))
        at = np.clip(start + np.arange(n) / scale, 0.0, photo.shape[axis] - 1.001)
        below = at.astype(int)
        part = (at - below)[:, None] if axis == 0 else at - below
        photo = (1 - part) * photo.take(below, axis) + part * photo.take(below + 1, axis)
    return np.asarray(255.0 * (photo / 255.0) ** float(np.exp(random.uniform(-0.4, 0.4))))


def scene(seed: int, photos: list[np.ndarray], data: bool = False) -> tuple[np.ndarray, Lamps]:
    """Bytes, and the truth of each light."""
    random = np.random.default_rng(90_000 + seed)
    lights = int(random.integers(1, 3 if data else MOST_LIGHTS + 1)) if random.random() < 0.5 else 0
    if photos and random.random() < 0.5:
        own = photos[seed % FOLDS :: FOLDS]
        photo = own[int(random.integers(len(own)))].astype(np.float64)
        picture = crop(random, photo)
        noise = float(random.uniform(0.0, 2.0))
    else:
        kind = light_scenes.GROUNDS[int(random.integers(len(light_scenes.GROUNDS)))]
        picture = light_scenes.ground(kind, random)
        noise = float(np.exp(random.uniform(0.0, np.log(8.0))))
    if random.random() < 0.1:  # few columns
        picture = picture[:, : int(random.integers(16, NARROW))]
    truth: Lamps = []
    for _ in range(lights):
        before = picture.copy()
        one = lamp(random, picture, data)
        if any(
            np.hypot(one["row"] - t["row"], one["column"] - t["column"]) < (one["size"] + t["size"]) / 2 for t in truth
        ):
            picture = before
            continue
        truth.append(one)
    noisy = picture + noise * random.standard_normal(picture.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), truth


def any_scene(seed: int, photos: list[np.ndarray], data: bool) -> tuple[np.ndarray, Lamps]:
    """As scene(); of tones, one in eleven with up to 20 lights."""
    if data or seed % BENCH_SCENES:
        return scene(seed, photos, data)
    random = np.random.default_rng(90_000 + seed)
    kind = light_scenes.GROUNDS[int(random.integers(len(light_scenes.GROUNDS)))]
    frame, truth, _ = light_scenes.scene(random, int(random.integers(0, 21)), kind)
    return frame, truth


def is_light(box: tuple[int, int, int, int], frequency: float, truth: Lamps, data: bool = False) -> bool:
    """True if a box holds a light of ``truth``.

    Its middle lies within the lamp, and its frequency agrees within 3 % (any frequency for data); or it touches the
    lamp's light, and its frequency agrees within 2 %.
    """
    x, y, width, height = box
    for one in truth:
        away = abs(y + height / 2 - one["row"]), abs(x + width / 2 - one["column"])
        beside = max(away[0] - height / 2, 0.0), max(away[1] - width / 2, 0.0)
        off = 0.0 if data else abs(frequency / one["frequency"] - 1)
        if max(away) < one["size"] / 2 and off < SAME_FREQUENCY:
            return True
        if np.hypot(*beside) < SPOT * one["size"] and off < 0.02:
            return True
    return False


def pictures(count: int, first: int, photos: list[np.ndarray], data: bool) -> Iterator[Picture]:
    for seed in range(first, first + count):
        yield *any_scene(seed, photos, data), seed % FOLDS, False
    for k, look in enumerate(photographs.looks(photos)):
        fold = k // 2 % FOLDS
        yield look, [], fold, True
        yield *with_lamps(look, k, data), fold, False


def with_lamps(look: np.ndarray, seed: int, data: bool = False) -> tuple[np.ndarray, Lamps]:
    """A photograph with up to three lamps, and noise."""
    random = np.random.default_rng(seed)
    picture = look.astype(np.float64)
    truth = [lamp(random, picture, data) for _ in range(random.integers(0, 4))]
    noisy = picture + random.standard_normal(picture.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), truth


def candidates(all_pictures: Iterator[Picture], data: bool) -> Candidates:
    rows = []
    for frame, truth, fold, plain in all_pictures:
        for box, frequency, _, odds, terms in _core.light_candidates(frame[None], light_scenes.CAMERA._handle, data):
            rows.append((terms, is_light(box, frequency, truth, data), fold, plain, odds))
    return Candidates(*(np.array(column) for column in zip(*rows, strict=True)))


def fitted(terms: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Logistic regression of terms in standard deviations: the intercept, then the coefficient of each term."""
    from sklearn.linear_model import LogisticRegression

    mean, spread = terms.mean(axis=0), terms.std(axis=0)
    model = LogisticRegression(max_iter=1000).fit((terms - mean) / spread, light)
    weights = model.coef_[0] / spread
    return np.concatenate([model.intercept_ - weights @ mean, weights])


def of_other_folds(found: Candidates) -> np.ndarray:
    """Probability of each candidate, with its odds, by a fit to the other folds."""
    logits = np.empty(len(found.light))
    for fold in range(FOLDS):
        judged = found.fold == fold
        values = fitted(found.terms[~judged], found.light[~judged])
        logits[judged] = values[0] + found.terms[judged] @ values[1:]
    return 1 / (1 + np.exp(-logits) / found.odds)


def required_odds(found: Candidates, probability: np.ndarray, looks: int) -> float:
    """Odds at one false light a photograph, such that half of each of photographs.RATES is held; they go with 1/rate.

    The other half is for the other kind, data or tones.
    """
    false = np.sort(probability[found.plain])[::-1]
    odds = [0.0]
    for rate in photographs.RATES:
        allowed = int(rate * looks / 2)
        if allowed < len(false):
            odds.append(rate * false[allowed] / (1 - false[allowed]))
    return max(odds)


def calibration(told: np.ndarray, light: np.ndarray) -> list[dict[str, float]]:
    """By tenths of the probability: number, mean probability, share of lights."""
    bins = []
    for low in np.arange(0.0, 1.0, 0.1):
        inside = (told >= low) & ((told < low + 0.1) | (low > 0.85))
        if inside.any():
            bins.append(
                {"count": int(inside.sum()), "told": float(told[inside].mean()), "lights": float(light[inside].mean())}
            )
    return bins


def between(told: np.ndarray, light: np.ndarray) -> dict[str, float]:
    """Compare probabilities from 0.1 to 0.9 with the share of lights; the standard error holds if they are right."""
    inside = (told >= 0.1) & (told < 0.9)
    count = int(inside.sum())
    error = float(np.sqrt((told * (1 - told))[inside].sum())) / max(count, 1)
    means = (float(x[inside].mean()) if count else 0.0 for x in (told, light))
    return {"count": count, **dict(zip(("told", "lights"), means, strict=True)), "standard_error": error}


def write(tone: np.ndarray, data: np.ndarray, odds: float) -> None:
    def constant(name: str, values: np.ndarray) -> str:
        numbers = ", ".join(f"{value:.4g}" for value in values[1:])
        return (
            f"inline constexpr double k{name}Intercept = {values[0]:.4g};\n"
            f"inline constexpr std::array<double, {len(values) - 1}> k{name}Weights{{{numbers}}};\n"
        )

    MODEL.write_text(
        "// Logistic models of lights, as written by bench/light_probability.py --write.\n#pragma once\n\n"
        "#include <array>\n\nnamespace ocisac {\n\n"
        f"{constant('Tone', tone)}{constant('Data', data)}"
        f"inline constexpr double kRequiredOdds = {odds:.2g};  // at one false light in a photograph\n\n"
        "}  // namespace ocisac\n"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    photographs.add_option(parser)
    parser.add_argument("--scenes", type=int, default=4000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene; the fit's are 0 to 3999")
    parser.add_argument("--write", action="store_true", help="write the fit to cpp/src/lights/light_model.hpp")
    options = parser.parse_args()
    photos = photographs.read(options.photographs, to_fit=True)
    print("photographs", len(photos))
    models, odds = {}, {}
    for kind in ("tones", "data"):
        data = kind == "data"
        found = candidates(pictures(options.scenes, options.first, photos, data), data)
        probability = of_other_folds(found)
        models[kind] = fitted(found.terms, found.light)
        odds[kind] = required_odds(found, probability, 2 * len(photos))
        numbers = {"candidates": len(found.light), "lights": int(found.light.sum()), "required_odds": odds[kind]}
        print(kind, numbers, "between 0.1 and 0.9", between(probability, found.light))
        for row in calibration(probability, found.light):
            print("   ", {name: round(value, 3) for name, value in row.items()})
    if options.write:
        # Data are rarer than tones: a prior by which both need the same odds.
        models["data"][0] -= np.log(odds["data"] / odds["tones"])
        write(models["tones"], models["data"], odds["tones"])


if __name__ == "__main__":
    main()
