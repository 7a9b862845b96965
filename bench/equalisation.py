"""Errors of the equaliser over kinds of light, exposures and noise, beside an oracle that knows the light's covariance.

The oracle is the dense linear estimate of least mean square error: covariances of light and rows over the ensemble that
the columns are drawn from, from as many draws as it takes, the noise known. It would know the frequency of a tone:
there the bound is that of Cramér and Rao for light whose mean, slope, amplitude, phase and frequency are unknown.
Errors are RMS over rows two exposures from the ends and over columns, against the light at t_n (tones, swells) or its
mean over a row time about t_n (chips).
"""

from __future__ import annotations

import argparse
import math

import numpy as np
import numpy.typing as npt

from ocisac_fast import Camera
from ocisac_fast.tones import equalize

Floats = npt.NDArray[np.float64]
ROW_TIME = 1e-5
EXPOSURES = (3.0, 5.0, 12.0, 30.0)  # rows
NOISES = (0.001, 0.01, 0.05)  # of full light
LIGHTS = [("tone", f) for f in (0.005, 0.02, 0.06, 0.18, 0.2, 0.31)]  # cycles a row
LIGHTS += [("swell", width) for width in (8.0, 20.0, 60.0)]  # rows, standard deviation of a Gaussian
LIGHTS += [("swell at an end", width) for width in (8.0, 20.0, 60.0)]
LIGHTS += [("chips", length) for length in (3.0, 9.0, 30.0)]  # rows a chip


def draw(kind: str, value: float, rows: int, exposure: float, random: np.random.Generator) -> tuple[Floats, Floats]:
    """Light and its mean over the exposures, of one column."""
    n = np.arange(rows)
    if kind == "tone":
        angle = 2 * np.pi * (value * n + random.random())
        x = value * exposure
        return 0.5 + 0.5 * np.cos(angle), 0.5 + 0.5 * np.sinc(x) * np.cos(angle - np.pi * x)
    if kind.startswith("swell"):
        place = random.random()
        middle = rows * (0.15 + 0.7 * place) if kind == "swell" else (120 * place - 60) % rows
        integral = np.vectorize(
            lambda t: value * math.sqrt(math.pi / 2) * math.erf((t - middle) / value / math.sqrt(2))
        )
        return np.exp(-0.5 * ((n - middle) / value) ** 2), (integral(n) - integral(n - exposure)) / exposure
    levels = random.integers(0, 2, int((rows + exposure) / value) + 6).astype(float)
    edges, sums = np.arange(len(levels) + 1) * value, np.concatenate([[0], np.cumsum(levels) * value])
    t = n + exposure + value * (1 + random.random())
    light = np.interp(t + 0.5, edges, sums) - np.interp(t - 0.5, edges, sums)
    return light, (np.interp(t, edges, sums) - np.interp(t - exposure, edges, sums)) / exposure


def columns_of(
    kind: str, value: float, rows: int, exposure: float, count: int, random: np.random.Generator
) -> tuple[Floats, Floats]:
    light, seen = zip(*(draw(kind, value, rows, exposure, random) for _ in range(count)), strict=True)
    return np.stack(light, axis=1), np.stack(seen, axis=1)


def bound_of_tone(frequency: float, exposure: float, noise: float, rows: int, inside: slice) -> float:
    """Least RMS error of unbiased estimates of mean, slope, amplitude, phase and frequency, over phases."""
    n, response = np.arange(rows) - (rows - 1) / 2, float(np.sinc(frequency * exposure))

    def derivatives(place: Floats, size: float, phase: float) -> Floats:
        angle = 2 * np.pi * frequency * place + phase
        tone = 0.5 * size * np.stack([np.cos(angle), np.sin(angle), place / rows * np.sin(angle)])
        return np.stack([np.ones(rows), place / rows, *tone], axis=1)

    variances = []
    for phase in np.pi * np.arange(4) / 4:
        seen = derivatives(n - exposure / 2, response, phase)
        light = derivatives(n, 1.0, phase)
        covariance = noise**2 * np.linalg.inv(seen.T @ seen)
        variances.append(np.einsum("ni,ij,nj->n", light, covariance, light)[inside].mean())
    return math.sqrt(float(np.mean(variances)))


def errors(
    kind: str, value: float, exposure: float, noise: float, rows: int, count: int, draws: int = 0
) -> dict[str, float]:
    """RMS error of each method; of the oracle, or of the bound of a tone, where ``draws`` are above 0."""
    random = np.random.default_rng([int(1000 * value), int(exposure), int(1000 * noise)])
    light, seen = columns_of(kind, value, rows, exposure, count, random)
    measured = seen + noise * random.standard_normal(seen.shape)
    camera = Camera(ROW_TIME, exposure * ROW_TIME)
    n = np.arange(rows)
    found = {
        "shift": np.stack([np.interp(n + exposure / 2, n, column) for column in measured.T], axis=1),
        "inverse": equalize(measured, camera),
        "wiener": equalize(measured, camera, method="wiener"),
    }
    inside = slice(int(2 * exposure) + 10, -int(2 * exposure) - 10)
    if draws and kind == "tone":
        bound = bound_of_tone(value, exposure, noise, rows, inside)
    elif draws:
        lights, rows_seen = columns_of(kind, value, rows, exposure, draws, random)
        means = lights.mean(axis=1, keepdims=True), rows_seen.mean(axis=1, keepdims=True)
        lights, rows_seen = lights - means[0], rows_seen - means[1]
        covariance = rows_seen @ rows_seen.T / draws + noise**2 * np.eye(rows)
        weights = np.linalg.solve(covariance, rows_seen @ lights.T / draws).T
        found["oracle"] = means[0] + weights @ (measured - means[1])
    result = {name: float(np.sqrt(np.mean((each - light)[inside] ** 2))) for name, each in found.items()}
    return result | ({"oracle": bound} if draws and kind == "tone" else {})


def cases() -> list[tuple[str, float, float, float]]:
    """Kind of light, its number, exposure and noise; without tones that hardly come through the exposure."""
    return [
        (kind, value, exposure, noise)
        for kind, value in LIGHTS
        for exposure in EXPOSURES
        for noise in NOISES
        if kind != "tone" or abs(np.sinc(value * exposure)) > 0.1
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--columns", type=int, default=20)
    parser.add_argument("--rows", type=int, default=720)
    parser.add_argument("--draws", type=int, default=4000, help="of the oracle; 0: none")
    options = parser.parse_args()
    print("| light | exposure | noise | shift | inverse | wiener | oracle | to the better of two | to the oracle |")
    print("|---|---|---|---|---|---|---|---|---|")
    for kind, value, exposure, noise in cases():
        error = errors(kind, value, exposure, noise, options.rows, options.columns, options.draws)
        better = 20 * math.log10(error["wiener"] / min(error["shift"], error["inverse"]))
        behind = 20 * math.log10(error["wiener"] / error["oracle"]) if "oracle" in error else math.nan
        figures = " | ".join(f"{error.get(name, math.nan):.4f}" for name in ("shift", "inverse", "wiener", "oracle"))
        print(f"| {kind} {value:g} | {exposure:g} | {noise:g} | {figures} | {better:+.1f} dB | {behind:+.1f} dB |")


if __name__ == "__main__":
    main()
