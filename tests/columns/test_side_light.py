"""Light beside a lamp against its twin and against the truth."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from ocisac_fast import Camera, _core, reference

CAMERA = Camera(22.2e-6)


def frame_of(random, rows, columns, hum, noise):
    """A lamp of random chips in the middle columns beside hum on all, in DN; the columns' weights and the hum."""
    across = np.exp(-0.5 * ((np.arange(columns) - columns / 2) / (columns / 8)) ** 2)
    chips = np.repeat(random.integers(0, 2, rows // 6 + 1), 6)[:rows]
    light = hum * np.sin(np.arange(rows) / 70 + random.uniform(0, 6))
    frame = 60 + 80 * chips[:, None] * across + light[:, None] + random.normal(0, noise, (rows, columns))
    return np.clip(np.rint(frame), 0, 240).astype(np.uint8), across / across.sum(), light


@settings(deadline=None, max_examples=settings.default.max_examples // 4)
@given(
    seed=st.integers(0, 2**32 - 1),
    rows=st.integers(4, 300),
    columns=st.integers(4, 100),
    hum=st.floats(0, 30),
    kind=st.sampled_from(["uint8", "uint16", "float32", "float64"]),
)
def test_the_light_beside_a_lamp_is_that_of_the_reference(seed, rows, columns, hum, kind):
    frame, weights, _ = frame_of(np.random.default_rng(seed), rows, columns, hum, 2.0)
    got = _core.side_light(frame.astype(kind), CAMERA._handle, weights)
    want = reference.side_light(frame.astype(np.float64), weights)
    assert (got is None) == (want is None)
    if want is not None:
        np.testing.assert_allclose(got[0], want[0], rtol=1e-12)
        assert got[1:] == pytest.approx(want[1:], rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("hum", [0.0, 5.0, 30.0])
def test_it_is_the_light_that_all_columns_share(hum):
    for seed in range(10):
        frame, weights, light = frame_of(np.random.default_rng(seed), 1080, 64, hum, 2.0)
        rows, varying, noise = _core.side_light(frame, CAMERA._handle, weights)
        assert np.std(rows - light) < 1.5
        assert noise == pytest.approx(2 / np.sqrt(20), rel=0.3)
        assert (varying > 3 * noise) == (hum > 0)


def test_saturated_columns_are_not_beside_the_lamp():
    frame, weights, light = frame_of(np.random.default_rng(1), 1080, 64, 20.0, 2.0)
    frame[:, :6] = 255
    rows, _, _ = _core.side_light(frame, CAMERA._handle, weights)
    assert np.std(rows - light) < 1.5
