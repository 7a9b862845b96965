"""Arrays that the core does not read as they are: a conversion keeps the meaning of the values."""

import numpy as np
import pytest

from ocisac_fast import Camera, Flag, remove_bands, tone_gain
from ocisac_fast.core.arrays import as_columns, as_frames

CAMERA = Camera(22.2e-6)
INTEGERS = [">u2", "<i4", ">i4", "u4", "i8", ">u8"]


def clipped():
    rng = np.random.default_rng(0)
    light = 50000 * (1 + 0.8 * np.sin(2 * np.pi * 700 * 22.2e-6 * np.arange(480)))
    return np.clip(rng.normal(0, 200, (480, 16)) + light[:, np.newaxis], 0, 65535).astype(np.uint16)


def unaligned(frame):
    return np.frombuffer(b"x" + frame.tobytes(), frame.dtype, offset=1).reshape(frame.shape)


@pytest.mark.parametrize("kind", INTEGERS)
@pytest.mark.parametrize("laid_out", [np.asarray, unaligned, np.asfortranarray])
def test_integers_keep_their_white_level(kind, laid_out):
    native = clipped()
    frame = laid_out(native.astype(kind))
    wanted, found = (tone_gain(x, CAMERA, frequency=700.0, pooled=True) for x in (native, frame))
    assert Flag.SATURATED in Flag(int(wanted.flags))
    assert (float(found.gain), int(found.flags)) == (float(wanted.gain), int(wanted.flags))
    wanted, found = remove_bands(native, CAMERA), remove_bands(frame, CAMERA)
    assert found.frames.dtype == np.uint16
    np.testing.assert_array_equal(found.frames, wanted.frames)
    np.testing.assert_array_equal(found.marks, wanted.marks)


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
