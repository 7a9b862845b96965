"""The form of a refusal: the argument, the value and what is allowed. test_bad_values has every argument."""

import numpy as np
import pytest

from ocisac_fast import Camera, tones
from ocisac_fast.cli.units import Quantity
from ocisac_fast.sensing import KnownMotion

CAMERA = Camera(1e-5, 1e-4, frame_time=1 / 30)
FRAME = 100 + 50 * np.sin(np.arange(64) * 0.3)[:, None] * np.ones(16)


def test_the_refusal_names_the_value_and_what_is_allowed():
    with pytest.raises(ValueError, match=r"^row_time: got '22us', allowed: a number or None$"):
        Camera(row_time="22us")
    with pytest.raises(ValueError, match=r"^camera: got 2.2e-05, allowed: a Camera$"):
        tones.tone_gain(FRAME, 22e-6, 500)
    with pytest.raises(ValueError, match=r"^frequency: got '500Hz', allowed: real numbers$"):
        tones.tone_gain(FRAME, CAMERA, "500Hz")
    with pytest.raises(ValueError, match=r"^bounds: got \('a', 1\), allowed: 2 numbers or None$"):
        tones.find_frequency(FRAME, CAMERA, bounds=("a", 1))


def test_each_number_of_a_class_is_compared_with_its_range():
    KnownMotion(pitch=Quantity(1.0))
    with pytest.raises(ValueError, match=r"^pitch: got 0.0, allowed: a finite number above 0 or None$"):
        KnownMotion(pitch=Quantity(0.0))
