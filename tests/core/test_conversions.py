"""Arrays that the core does not read as they are: a conversion keeps the meaning of the values (see test_laws, too)."""

import numpy as np
import pytest

from ocisac_fast import Camera, remove_bands, tone_gain
from ocisac_fast.core.arrays import as_columns, as_frames

CAMERA = Camera(22.2e-6)


@pytest.mark.parametrize("kind", [">f4", ">f8", "f2", "g", "?", "i2", "i8"])
def test_other_values_are_kept(kind):
    values = np.array([[0, 1, 7], [1, 1, 0]]).astype(kind)
    if kind in ("i2", "i8"):
        values[0, 0] = -3
    read = as_columns(values)
    assert read.dtype == (np.float32 if kind == ">f4" else np.float64)
    np.testing.assert_array_equal(read, values.astype(np.float64))


def test_a_masked_array_is_called_so():
    masked = np.ma.masked_greater(np.full((96, 8), 5.0), 4)
    for call in (lambda: tone_gain(masked, CAMERA, frequency=700.0), lambda: remove_bands(masked, CAMERA)):
        with pytest.raises(ValueError, match=r"^(columns|frames): got a masked array, allowed: real numbers"):
            call()


def test_all_frames_decide_the_type():
    frames = np.zeros((2, 4, 3, 3), np.int64)
    frames[1] = 70000
    assert as_frames(frames).dtype == np.float64
    assert as_frames(frames).max() == 70000
