"""Weighted sums of rows, and the sum of all bytes that they are timed against."""

import numpy as np
import pytest

from ocisac_fast import _core


def test_projection_of_a_frame_is_the_matrix_product():
    random = np.random.default_rng(5)
    frame = random.integers(0, 256, (45, 70), dtype=np.uint8)
    for group in (1, 2, 4, 8):
        weights = random.standard_normal((3, 45 // group))
        grouped = frame[: 45 // group * group].reshape(-1, group, 70).sum(axis=1, dtype=np.float64)
        sums, totals, squares, maximum = _core.project(frame, weights, group, 3)
        np.testing.assert_allclose(sums, weights @ grouped, rtol=0, atol=5e-8)
        np.testing.assert_array_equal(totals, grouped.sum(axis=0))
        np.testing.assert_array_equal(squares, (grouped**2).sum(axis=0))
        np.testing.assert_array_equal(maximum, frame[: 45 // group * group].max(axis=0))
        again = _core.project(frame, _core.RowWeights(weights, 45, group, 3))[0]
        np.testing.assert_array_equal(again, sums)
    with pytest.raises(ValueError, match="columns: got 44 rows"):
        _core.project(frame[:44], _core.RowWeights(weights, 45, 8, 1))
    with pytest.raises(ValueError, match="row_group: got 3, allowed: 1, 2, 4 or 8"):
        _core.project(frame, weights, 3, 1)


@pytest.mark.parametrize("size", [0, 1, 63, 4097, 3_000_000])
def test_reading_adds_every_byte(size):
    values = np.random.default_rng(6).integers(0, 256, size, dtype=np.uint8)
    for threads in (1, 3):
        assert _core.read_bytes(values, threads) == int(values.sum(dtype=np.int64))
    with pytest.raises(ValueError, match="array: got strides"):
        _core.read_bytes(np.zeros(20, np.uint8)[::2])
