"""Pictures of boxes for the tests of cleaning, and how near a picture is to the truth."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def boxes(
    seed: int, rows: int, columns: int, lowest: float, highest: float, ground: float = 0.5, count: int = 40
) -> Array:
    """Boxes of random grey between the lowest and the highest on an even ground."""
    random, margin = np.random.default_rng(seed), count // 4
    picture = np.full((rows, columns), ground)
    for _ in range(count):
        top, left = random.integers(0, rows - margin), random.integers(0, columns - margin)
        height, width = random.integers(8, 90, 2)
        picture[top : top + height, left : left + width] = random.uniform(lowest, highest)
    return picture


def psnr(picture: npt.NDArray[Any], truth: Array, kept: Any = slice(None)) -> float:
    return float(10 * np.log10(255**2 / np.mean((picture[kept] - truth[kept]) ** 2)))
