"""The spectrum of a column against the sum that defines it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from ocisac_fast import _core
from ocisac_fast.reference.tones import amplitude_spectrum


@given(st.integers(1, 300), st.integers(0, 2**32 - 1), st.floats(-10.0, 300.0))
def test_agrees_with_the_sum(rows: int, seed: int, level: float) -> None:
    signal = level + np.random.default_rng(seed).normal(size=rows)
    found, expected = _core.amplitude_spectrum(signal), amplitude_spectrum(signal)
    assert found.shape == (2 * rows + 1,)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * max(1.0, expected.max()))


def test_a_tone_of_full_depth_gives_its_depth() -> None:
    rows = np.arange(720)
    for cycles in (30.25, 200.0):
        found = _core.amplitude_spectrum(100.0 + 80.0 * np.cos(2 * np.pi * cycles * rows / 720))
        assert found.argmax() == 4 * cycles
        assert found.max() == pytest.approx(0.8, rel=0.01)  # the mean of 30.25 cycles is not 100
