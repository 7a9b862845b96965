"""Textures that scenes stand before."""

from __future__ import annotations

import numpy as np


def clouds(rows: int, columns: int, random: np.random.Generator, slope: float = 1.3) -> np.ndarray:
    """Smooth texture of all sizes, standard deviation 1; amplitudes fall with the frequency to the power ``slope``."""
    fy, fx = np.meshgrid(np.fft.fftfreq(rows), np.fft.rfftfreq(columns), indexing="ij")
    size = 1.0 / np.maximum(np.hypot(fx, fy), 1.0 / columns) ** slope
    field = np.fft.irfft2(size * np.exp(2j * np.pi * random.random(size.shape)), (rows, columns))
    return np.asarray(field / field.std())


def add_boxes(
    picture: np.ndarray,
    random: np.random.Generator,
    sides: tuple[int, int],
    levels: tuple[float, float],
    count: int = 60,
    margin: int = 20,
) -> None:
    """Put even boxes of these sides and levels one over another; they begin outside a margin below and right."""
    rows, columns = picture.shape
    for _ in range(count):
        top, left = random.integers(0, rows - margin), random.integers(0, columns - margin)
        height, width = random.integers(*sides, 2)
        picture[top : top + height, left : left + width] = random.uniform(*levels)


def add_text(picture: np.ndarray, random: np.random.Generator, line: int, level: float) -> None:
    """Put lines of letters of this level, ``line`` rows apart."""
    rows, columns = picture.shape
    for top in range(20, rows - 40, line):
        for left in range(20, columns - 40, 12):
            stroke = random.integers(0, 4)
            picture[top : top + 16, left + 2 * stroke : left + 2 * stroke + 3] = level
            picture[top + 4 * stroke : top + 4 * stroke + 3, left : left + 9] = level
