"""How often ``ocisac gain`` notices other light, and how well it knows it: one line a kind of draw.

Bytes of a square wave whose lamp fades out over 160 columns. Width, brightness, frequency, exposure, noise are random.
"""

from __future__ import annotations

import argparse

import numpy as np

from ocisac_fast import Camera, SquareWave, integrate_exposure
from ocisac_fast.cli.doubts import other_light

ROWS, COLUMNS = 720, 160
KINDS = ("clean", "other light", "textured lamp", "sRGB, stated", "gamma, not stated")


def stored(light: np.ndarray, kind: str) -> np.ndarray:
    """Values of 0 to 255 of linear light."""
    share = light / 255
    if kind == "sRGB, stated":
        return 255 * np.where(share <= 0.0031308, 12.92 * share, 1.055 * np.maximum(share, 1e-9) ** (1 / 2.4) - 0.055)
    return 255 * share**0.45 if kind == "gamma, not stated" else light


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=300)
    parser.add_argument("--seed", type=int, default=9000)
    arguments = parser.parse_args()
    results: dict[str, list[tuple[float, float] | None]] = {kind: [] for kind in KINDS}
    for draw in range(arguments.draws):
        random, kind = np.random.default_rng(arguments.seed + draw), KINDS[draw % len(KINDS)]
        curve = "srgb" if kind == "sRGB, stated" else "linear"
        camera = Camera(22.2e-6, exposure=random.uniform(1e-4, 1.5e-3), tone_curve=curve)
        frequency = random.uniform(150, 3000)
        theory = abs(np.sinc(frequency * camera.exposure))
        if theory < 0.1:
            continue
        wave = integrate_exposure(SquareWave(frequency, phase=random.uniform(0, 6)), camera, np.arange(ROWS))
        lamp = np.exp(-0.5 * (np.linspace(-1, 1, COLUMNS) / random.uniform(0.3, 1.5)) ** 2)
        if kind == "textured lamp":
            lamp *= np.exp(0.3 * random.standard_normal(COLUMNS))
        level = random.uniform(5, 60) if kind == "other light" else 0.0
        light = random.uniform(60, 180) * wave[:, None] * lamp / lamp.max() + level
        noise = random.uniform(0.3, 4) * random.standard_normal(light.shape)
        pixels = np.clip(np.rint(stored(light, kind) + noise), 0, 255).astype(np.uint8)
        mean = pixels.mean(axis=0)
        found = other_light(pixels[:, mean > 0.3 * mean.max()], camera, frequency, {"waveform": "square"})
        results[kind].append(None if found is None else (found[0] - level, found[1] / theory - 1))
    for kind, every in results.items():
        errors = np.array([each for each in every if each is not None])
        line = f"{kind:18s} {len(every):4d} draws, {len(errors):4d} with a warning"
        if len(errors):
            rms, most = np.sqrt(np.mean(errors**2, axis=0)), np.abs(errors).max(axis=0)
            line += f"; level off {rms[0]:.2f} DN RMS, {most[0]:.2f} at most; gain {rms[1]:.2%}, {most[1]:.2%}"
        print(line)


if __name__ == "__main__":
    main()
