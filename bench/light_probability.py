#!/usr/bin/env python3
"""Fit of the probability that a detected tone is a light, and its calibration on scenes that were not fitted.

Grounds of light_scenes.py, half of them without a light, with lamps of 2.5 cycles and more; crops of photographs in
both directions, half of them with lamps put onto them; and, one in eleven, whole scenes of light_scenes.py. The
printed coefficients are of tones in their whole boxes and of their own pixels; calibration is judged fold by fold, with
fits to the other folds, which have other photographs, and of the code. The coefficients of the code's fit
(cpp/src/lights/light_probability.cpp) are of an earlier version of the own pixels; its step to what users see is the
correction that `--first 40000 --scenes 8200 --only tones` prints.

usage: bench/light_probability.py [--photographs FOLDER] [--scenes N] [--first SEED] [--only tones|data]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, fields
from typing import Any

import light_scenes
import numpy as np
import photographs

from ocisac_fast import Chips, SquareWave, Tone, Waveform, _core, integrate_exposure
from ocisac_fast.packets import encode_line_code

NAMES = (
    "suspects", "cycles", "width", "texture", "uneven", "aperiodic", "uncommon", "depth", "contour", "company", "across"
)  # fmt: skip
COMPANY = NAMES.index("company")
DATA_NAMES = ("suspects", "edges", "clock", "width", "texture", "uncommon", "aperiodic")
NARROW = 200  # columns of a frame that a light fills
BENCH_SCENES = 11  # every one of these is a scene of light_scenes.py
SAME_FREQUENCY = 0.03  # relative, as of light_scenes.judge
FOLDS = 6  # of scenes by their seeds; each has photographs of its own
MOST_LIGHTS = 7  # of scene()
MANY_LIGHTS = 10  # expected number of others beyond which a picture is one of many; 7, 8.5 and 12 fit worse
SPOT = 0.75  # reach of a lamp's light around its centre, relative to its size
RIDGE = 1.0  # prior precision of a coefficient, of features in standard deviations


@dataclass(frozen=True)
class Candidates:
    """Features (candidates, features), 1 for lights, and the seed of each candidate's picture."""

    features: np.ndarray
    light: np.ndarray
    seed: np.ndarray
    told: np.ndarray  # probability by the code
    fitted: np.ndarray  # before its correction
    inside: np.ndarray  # features of its own pixels

    def part(self, used: np.ndarray) -> Candidates:
        return Candidates(*(getattr(self, field.name)[used] for field in fields(self)))


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


def scene(seed: int, photos: list[np.ndarray], data: bool = False) -> tuple[np.ndarray, list[dict[str, float]]]:
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
    truth: list[dict[str, float]] = []
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


def any_scene(seed: int, photos: list[np.ndarray], data: bool) -> tuple[np.ndarray, list[dict[str, float]]]:
    """As scene(); of tones, one in eleven with up to 20 lights."""
    if data or seed % BENCH_SCENES:
        return scene(seed, photos, data)
    random = np.random.default_rng(90_000 + seed)
    kind = light_scenes.GROUNDS[int(random.integers(len(light_scenes.GROUNDS)))]
    frame, truth, _ = light_scenes.scene(random, int(random.integers(0, 21)), kind)
    return frame, truth


def is_light(
    box: tuple[int, int, int, int], frequency: float, truth: list[dict[str, float]], data: bool = False
) -> bool:
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


def candidates(count: int, photos: list[np.ndarray], data: bool = False, first: int = 0) -> Candidates:
    rows: list[list[float]] = []
    light, seeds, told, fitted, inside = [], [], [], [], []
    for seed in range(first, first + count):
        frame, truth = any_scene(seed, photos, data)
        found = _core.light_candidates(frame[None], light_scenes.CAMERA._handle, data)
        for box, frequency, probability, before, features, own in found:
            rows.append(features)
            light.append(is_light(box, frequency, truth, data))
            seeds.append(seed)
            told.append(probability)
            fitted.append(before)
            inside.append(own)
    columns = (rows, np.array(light, float), seeds, told, fitted, inside)
    return Candidates(*(np.array(column) for column in columns))


def terms(features: np.ndarray) -> np.ndarray:
    """The features and their squares."""
    return np.concatenate([features, features**2], axis=1)


def fitted(features: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Logistic regression by Newton steps: the intercept, then a coefficient for each term.

    The first feature, ln(suspects), has the coefficient -1 and no square: every suspect is a chance of a texture.
    """
    offset = -features[:, 0]
    features = terms(features[:, 1:])
    mean, spread = features.mean(axis=0), features.std(axis=0) + 1e-9
    design = np.concatenate([np.ones((len(features), 1)), (features - mean) / spread], axis=1)
    prior = np.diag([0.0] + [RIDGE] * features.shape[1])
    values = np.zeros(design.shape[1])
    values[0] = -offset.mean()
    for _ in range(40):
        told = 1 / (1 + np.exp(-(offset + design @ values)))
        slope = design.T @ (light - told) - prior @ values
        bend = (design * (told * (1 - told))[:, None]).T @ design + prior
        step = np.linalg.solve(bend, slope)
        values = values + step / max(1.0, float(np.abs(step).max()))
    of_features = values[1:] / spread
    linear, square = np.split(of_features, 2)
    return np.concatenate([[values[0] - of_features @ mean, -1.0], linear, [0.0], square])


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


def logits(values: np.ndarray, features: np.ndarray) -> np.ndarray:
    return np.asarray(values[0] + terms(features) @ values[1:])


def likeliest(design: np.ndarray, light: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Coefficients of a logistic regression by maximum likelihood: Newton steps of at most 0.2."""
    values = start
    for _ in range(40):
        told = 1 / (1 + np.exp(-design @ values))
        bend = (design * (told * (1 - told))[:, None]).T @ design + 1e-6 * np.eye(len(values))
        step = np.linalg.solve(bend, design.T @ (light - told))
        values = values + 0.2 * step / max(0.2, float(np.abs(step).max()))
    return values


def shrunk(found: Candidates, used: np.ndarray) -> np.ndarray:
    """A fit to the candidates `used`, corrected to what fits without a fold tell of that fold.

    It is moved, scaled, and its weight of company changed. A fit is too sure of photographs that it has not seen: their
    textures are few.
    """
    fold = found.seed % FOLDS
    fresh = np.full(len(found.light), np.nan)
    for one in np.unique(fold[used]):
        others = used & (fold != one)
        fresh[fold == one] = logits(fitted(found.features[others], found.light[others]), found.features[fold == one])
    company = found.features[used][:, COMPANY : COMPANY + 1]  # none of data
    design = np.concatenate([np.ones((int(used.sum()), 1)), fresh[used][:, None], company], axis=1)
    change = likeliest(design, found.light[used], np.eye(design.shape[1])[1])
    values = change[1] * fitted(found.features[used], found.light[used])
    values[0] += change[0]
    values[1 + COMPANY : 1 + COMPANY + company.shape[1]] += change[2:]
    return np.asarray(values)


def fit(found: Candidates, names: tuple[str, ...]) -> dict[str, Any]:
    """Coefficients fitted to all candidates; calibration of fits without a fold on that fold."""
    fresh = np.empty(len(found.light))
    for fold in range(FOLDS):
        judged = found.seed % FOLDS == fold
        fresh[judged] = 1 / (1 + np.exp(-logits(shrunk(found, ~judged), found.features[judged])))
    values = shrunk(found, np.ones(len(found.light), bool))
    return {
        "candidates": len(found.light),
        "lights": int(found.light.sum()),
        "intercept": round(float(values[0]), 3),
        "linear": dict(zip(names, np.round(values[1 : 1 + len(names)], 3).tolist(), strict=True)),
        "square": dict(zip(names, np.round(values[1 + len(names) :], 3).tolist(), strict=True)),
        "calibration": calibration(fresh, found.light),
        **of_the_code(found),
    }


def correction(found: Candidates) -> dict[str, float]:
    """Fit the code's step from its fit p to the probability that users see, by maximum likelihood.

    Its logit is above·(−ln(1 − p)) + below·ln p + shift (beta calibration, Kull et al. 2017) and, among K other lights,
    many_lights/(1 + e^(10 − K)).
    """
    fitted = np.clip(found.fitted, 1e-12, 1 - 1e-12)
    many = 1 / (1 + np.exp(MANY_LIGHTS - np.expm1(found.features[:, COMPANY])))
    design = np.stack([-np.log(1 - fitted), np.log(fitted), np.ones(len(fitted)), many], axis=1)
    values = likeliest(design, found.light, np.array([1.0, 1.0, 0.0, 0.0]))
    return dict(zip(("above", "below", "shift", "many_lights"), np.round(values, 2).tolist(), strict=True))


def between(told: np.ndarray, light: np.ndarray) -> dict[str, float]:
    """Compare probabilities from 0.1 to 0.9 with the share of lights; the standard error holds if they are right."""
    inside = (told >= 0.1) & (told < 0.9)
    count = int(inside.sum())
    error = float(np.sqrt((told * (1 - told))[inside].sum())) / max(count, 1)
    means = (float(x[inside].mean()) if count else 0.0 for x in (told, light))
    return {"count": count, **dict(zip(("told", "lights"), means, strict=True)), "standard_error": error}


def of_the_code(found: Candidates) -> dict[str, Any]:
    """Calibration of the code's probabilities: of all scenes, those with up to 20 lights, and the others."""
    many = found.seed % BENCH_SCENES == 0
    parts = {"": found, "_many_lights": found.part(many), "_other_scenes": found.part(~many)}
    return {
        **{f"calibration_of_the_code{name}": calibration(part.told, part.light) for name, part in parts.items()},
        **{f"between_0.1_and_0.9{name}": between(part.told, part.light) for name, part in parts.items()},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    photographs.add_option(parser)
    parser.add_argument("--scenes", type=int, default=4000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene; the fit's are 0 to 3999")
    parser.add_argument("--only", choices=("tones", "data"))
    options = parser.parse_args()
    pictures = photographs.read(options.photographs)
    report: dict[str, Any] = {"photographs": len(pictures)}
    for kind, names in (("tones", NAMES), ("data", DATA_NAMES)):
        if options.only in (None, kind):
            found = candidates(options.scenes, pictures, kind == "data", options.first)
            report[kind] = fit(found.part(~found.inside), names)
            if kind == "tones":
                report["own pixels"] = fit(found.part(found.inside), names)
                both = found
                report["both"] = {"correction": correction(both), **of_the_code(both)}
    print("photographs", report["photographs"])
    for kind in set(report) - {"photographs"}:
        for name, value in report[kind].items():
            print(kind, name, value if not isinstance(value, list) else "")
            for row in value if isinstance(value, list) else ():
                print("   ", {k: round(v, 3) for k, v in row.items()})


if __name__ == "__main__":
    main()
