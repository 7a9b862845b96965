"""Columns of the light that `ocisac gain` measures."""

import numpy as np
import pytest

from ocisac_fast.cli.gain import Light

COLUMNS = np.arange(40)


@pytest.mark.parametrize(
    "used",
    [COLUMNS >= 0, COLUMNS < 0, COLUMNS >= 35, COLUMNS < 3, COLUMNS // 10 % 2 == 0, COLUMNS * 7 % 5 < 2],
    ids=["all", "none", "last", "first", "blocks", "single ones"],
)
def test_columns_are_those_of_the_light_in_order(used):
    frames = np.random.default_rng(1).integers(0, 255, (3, 7, 40, 2)).astype(np.uint8)
    light = Light("y", 1.0, None, [], 1, used, 0)
    found = light.columns(frames)
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, frames[..., 1][..., used])
    runs = np.count_nonzero(np.diff(np.concatenate([[0], used, [0]])) == 1)
    assert np.shares_memory(found, frames) == (runs == 1)
