"""Outline and tone of a short light: the twin, and what may not change them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings, strategies as st

from ocisac_fast import _core, reference

FloatArray = npt.NDArray[np.float64]
Scene = tuple[FloatArray, npt.NDArray[np.bool_], float, npt.NDArray[np.bool_]]


def scene(seed: int, texture: float = 0.05) -> Scene:
    """Log light of a round lamp on textured ground, a rough guess of its pixels, its frequency, and its pixels."""
    random = np.random.default_rng(seed)
    rows, groups = int(random.integers(60, 130)), int(random.integers(4, 14))
    height = random.uniform(0.35, 0.6) * rows
    cycles = random.uniform(2.6, 7.0)
    frequency = cycles / height
    n, g = np.arange(rows)[:, None], np.arange(groups)
    row, column = rows / 2 + random.uniform(-3, 3), (groups - 1) / 2
    lamp = ((n - row) / (height / 2)) ** 2 + ((g - column) / (0.45 * groups)) ** 2 < 1
    wave = random.uniform(0.6, 1.5) * np.cos(2 * np.pi * frequency * n + random.uniform(0, 6))
    wave = np.sign(wave) * np.abs(wave) ** 0.5 if seed % 2 else wave
    ground = np.cumsum(random.normal(0, texture, (rows, groups)), axis=0) + random.uniform(-1, 1)
    light = np.where(lamp, 1.0 + 0.01 * n + wave, ground) + random.uniform(0.02, 0.1) * random.normal(size=ground.shape)
    guess = (np.abs(n - row - random.uniform(-4, 4)) < 0.45 * height) & (g >= 1) & (g < groups - 1)
    return light, guess, frequency, lamp


def outline(light: FloatArray, guess: npt.NDArray[np.bool_], frequency: float) -> tuple[float, list[list[bool]]] | None:
    found = _core.fit_outline(light, guess, frequency)
    return None if found is None else (pytest.approx(found[0], rel=1e-6), found[1].astype(bool).tolist())


@settings(max_examples=25)
@given(seed=st.integers(0, 2**31), off=st.floats(-0.08, 0.08))
def test_the_outline_is_that_of_the_twin(seed: int, off: float) -> None:
    light, guess, frequency, _ = scene(seed)
    expected = reference.fit_outline(light, guess, frequency * (1 + off))
    found = outline(light, guess, frequency * (1 + off))
    assert found == (None if expected is None else (expected[0], expected[1].tolist()))


@given(seed=st.integers(0, 2**31), level=st.floats(-5, 5))
def test_levels_of_columns_and_their_order_do_not_matter(seed: int, level: float) -> None:
    light, guess, frequency, _ = scene(seed)
    found = _core.fit_outline(light, guess, frequency)
    levels = level + np.random.default_rng(seed).normal(size=light.shape[1])
    moved = outline(light + levels, guess, frequency)
    mirrored = outline(light[:, ::-1], guess[:, ::-1], frequency)
    assert moved == (None if found is None else (found[0], found[1].astype(bool).tolist()))
    assert mirrored == (None if found is None else (found[0], found[1][:, ::-1].astype(bool).tolist()))


def test_frequency_and_outline_are_the_lamps() -> None:
    errors, shared = [], []
    for seed in range(200):
        light, guess, frequency, lamp = scene(seed)
        found = _core.fit_outline(light, guess, frequency * (1 + 0.05 * np.cos(seed)))
        if found is not None:
            own = found[1].astype(bool)
            errors.append(abs(found[0] / frequency - 1))
            shared.append((own & lamp).sum() / (own | lamp).sum())
    assert len(errors) >= 198
    assert np.median(errors) < 0.002
    assert max(errors) < 0.03
    assert np.median(shared) > 0.8
