"""The slope of an oblique lamp against its twin and against the truth."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from ocisac_fast import _core, reference

BLOCK = 8  # columns


def swings_of(random, slope, *, rows, blocks, width, noise, spot=math.inf):
    """Swings of blocks of columns of a lamp through the middle, and the blocks' centres."""
    centres = BLOCK * (np.arange(blocks) + 0.5) - 0.5
    row = np.arange(rows) - (rows - 1) / 2
    middle = centres.mean() + slope * row
    shape = np.exp(-0.5 * ((centres[:, None] - middle) / width) ** 2 - 0.5 * (row / spot) ** 2)
    chips = np.repeat(random.choice([-1.0, 1.0], rows // 6 + 1), 6)[:rows]
    return 50 * shape * chips + random.normal(0, noise, shape.shape), centres


@settings(deadline=None, max_examples=settings.default.max_examples // 2)
@given(
    seed=st.integers(0, 2**32 - 1),
    slope=st.floats(-0.3, 0.3),
    rows=st.integers(100, 1200),
    blocks=st.integers(2, 40),
    noise=st.floats(0.1, 30),
    spot=st.just(math.inf) | st.floats(80, 400),
)
def test_the_slope_is_that_of_the_reference(seed, slope, rows, blocks, noise, spot):
    random = np.random.default_rng(seed)
    swings, centres = swings_of(random, slope, rows=rows, blocks=blocks, width=16.0, noise=noise, spot=spot)
    got, want = (module.lamp_slope(swings, centres) for module in (_core, reference))
    assert got == pytest.approx(want, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("degrees", [-15, -3, 3, 10])
def test_the_slope_is_the_truth(degrees):
    slope = math.tan(math.radians(degrees))
    for seed in range(10):
        options = {"rows": 1080, "blocks": 40, "width": 16.0, "noise": 2.0}
        got = _core.lamp_slope(*swings_of(np.random.default_rng(seed), slope, **options))
        assert got == pytest.approx(slope, rel=0.02)


def test_an_upright_lamp_has_no_slope():
    for seed in range(50):
        options = {"rows": 1080, "blocks": 40, "width": 16.0, "noise": 8.0}
        assert _core.lamp_slope(*swings_of(np.random.default_rng(seed), 0.0, **options)) == 0
