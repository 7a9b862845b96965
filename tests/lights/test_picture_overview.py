"""The comparison of a picture with a later one beside its lights."""

import numpy as np
import pytest

from ocisac_fast import _core

SHAPES = [(480, 640), (71, 333), (64, 160)]
LIGHTS = [(10, 5, 40, 30)]  # x, y, width, height
MARGIN = 32 + 10  # rows and columns about a light that are not compared


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_patch_changes_the_picture_and_noise_does_not(shape, dtype):
    """Also in other strides; not where the lights are."""
    random = np.random.default_rng(shape[0] + np.dtype(dtype).num)
    for k in range(24):
        scene = random.uniform(40.0, 160.0, shape)
        noise = random.choice([0.01, 1.0, 3.0])
        then, quiet = (scene + random.normal(0.0, noise, shape) for _ in range(2))
        away, near = quiet.copy(), quiet.copy()
        y, x = int(random.integers(0, shape[0] - 32)), int(random.integers(50 + MARGIN, shape[1] - 64))
        away[y : y + 32, x : x + 64] += 4.0 + 4.0 * noise
        near[: 35 + 32, : 50 + MARGIN - 32] += 40.0
        pictures = [then, quiet, away, near]
        if np.dtype(dtype).kind == "u":
            pictures = [np.rint(picture) for picture in pictures]
        pictures = [picture.astype(dtype) for picture in pictures]
        if k % 2:
            pictures = [np.asfortranarray(picture)[::-1].copy()[::-1] for picture in pictures]
        then, *later = (_core.PictureOverview(picture) for picture in pictures)
        assert [then.has_changed(now, LIGHTS) for now in later] == [False, True, False], (k, noise)
        assert then.has_changed(later[2], [])


@pytest.mark.parametrize("shape", [(40, 5), (3, 200), (1, 1), (33, 31)])
def test_small_pictures_are_compared(shape):
    then = np.full(shape, 90, np.uint8)
    before, after = _core.PictureOverview(then), _core.PictureOverview(then + np.uint8(60))
    assert not before.has_changed(before, [])
    assert before.has_changed(after, []) == (shape[0] >= 32)


def test_shapes_must_agree():
    with pytest.raises(ValueError, match="shape of the first"):
        _core.PictureOverview(np.zeros((40, 40))).has_changed(_core.PictureOverview(np.zeros((41, 40))), [])


def test_samples_that_are_not_finite_change_nothing_where_they_stay():
    picture = np.full((64, 64), np.nan)
    overview = _core.PictureOverview(picture)
    assert not overview.has_changed(overview, [])
