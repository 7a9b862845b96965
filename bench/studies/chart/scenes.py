"""Scenes for the comparison of gain methods, and the Cramér-Rao bound of each."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s

Bytes = npt.NDArray[np.uint8]

_PHASES = 16  # light phases over which the bound is averaged


@dataclass(frozen=True)
class Scene:
    """Columns of one light with random phases, as bytes."""

    name: str  # key in tables
    title: str  # of the panel
    cycles: float  # of the light in the frame
    exposure_cycles: float = 0.6  # f T_e; the true gain is |sinc(f T_e)| times the depth
    depth: float = 1.0  # amplitude of the fundamental over that of a fully modulated light
    mean: float = 100.0  # of the light, DN
    noise: float = 2.0  # RMS of a row, independent of the light, DN
    shot: float = 0.0  # variance of a row per DN of light, DN
    waveform: Literal["tone", "square"] = "tone"  # square: duty 1/2
    rows: int = 1080
    columns: int = 1920
    row_time: float = 22.2e-6  # s

    @property
    def cycles_per_row(self) -> float:
        """f T_r."""
        return self.cycles / self.rows

    @property
    def frequency(self) -> float:
        """Frequency of the light, Hz."""
        return self.cycles_per_row / self.row_time

    @property
    def camera(self) -> Camera:
        """The camera of the scene."""
        return Camera(self.row_time, self.exposure_cycles / self.frequency)

    @property
    def gain(self) -> float:
        """The true gain."""
        return self.depth * float(np.abs(np.sinc(self.exposure_cycles)))

    @property
    def ratio(self) -> float:
        """Amplitude of the fundamental over the mean at full depth, without exposure."""
        return 1.0 if self.waveform == "tone" else 4.0 / np.pi

    def light(self, phase: npt.ArrayLike) -> Float64s:
        """(rows, phases) mean light over the exposures (eq. 4), DN; phases in cycles at row 0."""
        x = np.arange(self.rows)[:, None] * self.cycles_per_row + np.asarray(phase, dtype=np.float64)[None, :]
        if self.waveform == "square":
            bright = (_bright_time(x) - _bright_time(x - self.exposure_cycles)) / self.exposure_cycles
            return np.asarray(self.mean * (1.0 + self.depth * (2.0 * bright - 1.0)))
        delayed = x - 0.5 * self.exposure_cycles
        swing = self.depth * np.sinc(self.exposure_cycles)
        return np.asarray(self.mean * (1.0 + swing * np.cos(2.0 * np.pi * delayed)))

    def frames(self, count: int) -> Iterator[Bytes]:
        """Frames of bytes, equal in every run."""
        random = np.random.default_rng(zlib.crc32(self.name.encode()))
        for _ in range(count):
            values = self.light(random.random(self.columns))
            if self.shot > 0.0:
                values = np.asarray(self.shot * random.poisson(values / self.shot), dtype=np.float64)
            noisy = values + self.noise * random.standard_normal(values.shape)
            yield np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

    def bound(self) -> float:
        """Cramér-Rao bound of the gain's standard deviation, RMS over the light's phases.

        Free parameters are mean, fundamental and, for the square wave, every harmonic below half the row rate. The
        variance of each row is the sum of noise, shot noise and 1/12 for rounding.
        """
        orders = odd_harmonics(self.cycles_per_row, self.rows) if self.waveform == "square" else [1]
        design = design_matrix(self.rows, self.cycles_per_row, orders)
        fit = least_squares(design)
        variances = [self._variance(design, fit, phase) for phase in np.arange(_PHASES) / _PHASES]
        return float(np.sqrt(np.mean(variances)))

    def _variance(self, design: Float64s, fit: Float64s, phase: float) -> float:
        light = self.light([phase])[:, 0]
        row_variance = self.noise**2 + self.shot * light + 1.0 / 12.0
        covariance = np.linalg.inv(design.T @ (design / row_variance[:, None]))[:3, :3]
        mean, cosine, sine = fit[:3] @ light
        amplitude = np.hypot(cosine, sine)
        gradient = np.array([-amplitude / mean, cosine / amplitude, sine / amplitude]) / (mean * self.ratio)
        return float(gradient @ covariance @ gradient)


def _bright_time(cycles: Float64s) -> Float64s:
    """Antiderivative of the square wave (duty 1/2, bright about whole cycles)."""
    shifted = cycles + 0.25
    whole = np.floor(shifted)
    return np.asarray(0.5 * whole + np.minimum(shifted - whole, 0.5))


def design_matrix(rows: int, cycles_per_row: float, harmonics: list[int]) -> Float64s:
    """(rows, 1 + 2·harmonics): 1, then cosine and sine of each harmonic."""
    turns = np.outer(np.arange(rows), cycles_per_row * np.asarray(harmonics, dtype=np.float64))
    angles = 2.0 * np.pi * (turns - np.rint(turns))
    waves = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(rows, -1)
    return np.concatenate([np.ones((rows, 1)), waves], axis=1)


def least_squares(design: Float64s) -> Float64s:
    """Pseudo-inverse of a well-conditioned design."""
    return np.asarray(np.linalg.solve(design.T @ design, design.T), dtype=np.float64)


def odd_harmonics(cycles_per_row: float, rows: int, row_group: int = 1) -> list[int]:
    """The fundamental and odd harmonics below half the row rate whose aliases by groups of rows do not coincide."""
    rate = 1.0 / row_group  # samples per row
    seen = [0.0, 0.5 * rate]
    kept: list[int] = []
    for order in range(1, int(0.5 / cycles_per_row) + 1, 2):
        folded = abs((order * cycles_per_row / rate + 0.5) % 1.0 - 0.5) * rate
        if 4 * len(kept) + 6 > rows // row_group:
            break
        if order == 1 or all(abs(folded - other) * rows >= 1.0 for other in seen):
            kept.append(order)
            seen.append(folded)
    return kept


SCENES = [
    Scene("on-bin", "On a bin (12 cycles)", 12.0),
    Scene("off-bin", "Off a bin (36.5 cycles)", 36.5),
    Scene("few-cycles", "Few cycles (1.6)", 1.6),
    Scene("weak", "Weak tone, strong mean", 12.37, depth=0.02, mean=180.0),
    Scene("low-light", "Low light (4 DN, shot noise)", 12.37, mean=4.0, noise=0.5, shot=0.25),
    Scene("harmonics", "Strong harmonics (square)", 5.3, exposure_cycles=0.1, depth=0.9, waveform="square"),
]
