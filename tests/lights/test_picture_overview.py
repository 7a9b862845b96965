"""The comparison of pictures against the reference in NumPy."""

import numpy as np
import pytest

from ocisac_fast import _core
from ocisac_fast.reference import overview as reference

SHAPES = [(480, 640), (71, 333), (64, 32), (33, 31), (40, 5), (3, 200), (1, 1)]
LIGHTS = [[], [(10, 5, 40, 30)], [(0, 0, 7, 9), (25, 20, 6, 12)]]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("shape", SHAPES)
def test_change_agrees_with_the_reference(shape, dtype):
    random = np.random.default_rng(shape[0] + np.dtype(dtype).num)
    integers, changed = np.dtype(dtype).kind == "u", []
    for k in range(60):
        then = random.normal(90.0, 20.0, shape)
        now = then + random.normal(0.0, random.choice([0.01, 1.0, 3.0]), shape)
        y, x = (int(random.integers(0, length)) for length in shape)
        now[y : y + 32, x : x + 64] += random.uniform(0.0, 6.0)
        then, now = (np.clip(np.rint(one) if integers else one, 0, 255).astype(dtype) for one in (then, now))
        if k % 2:  # other strides
            then, now = np.asfortranarray(then), now[::-1].copy()[::-1]
        lights = LIGHTS[k % 3]
        wanted = reference.has_changed(reference.overview(then), reference.overview(now), lights, integers)
        assert _core.PictureOverview(then).has_changed(_core.PictureOverview(now), lights) == wanted
        changed.append(wanted)
    if shape[0] > 64:
        assert 5 < sum(changed) < 55


def test_shapes_must_agree():
    with pytest.raises(ValueError, match="shape of the first"):
        _core.PictureOverview(np.zeros((40, 40))).has_changed(_core.PictureOverview(np.zeros((41, 40))), [])


def test_samples_that_are_not_finite_change_nothing_where_they_stay():
    picture = np.full((64, 64), np.nan)
    overview = _core.PictureOverview(picture)
    assert not overview.has_changed(overview, [])
