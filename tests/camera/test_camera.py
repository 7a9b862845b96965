"""The camera and the exposure's response."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import ocisac_fast as ocisac
from ocisac_fast import Camera, reference, tones


@settings(deadline=None, max_examples=60)
@given(
    frequency=st.lists(st.floats(-1e5, 1e5), min_size=1, max_size=20),
    exposure=st.sampled_from([0.0, 1e-9, 622e-6, 2404e-6, 1e-2]),
)
def test_response_agrees_with_the_reference(frequency, exposure):
    got = ocisac.exposure_response(frequency, exposure)
    want = reference.exposure_response(frequency, exposure)
    assert got.shape == (len(frequency),)
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-12)


def test_response_is_the_integral_over_the_exposure():
    frequency, exposure = 700.0, 1.1e-3
    times = (np.arange(100_000) + 0.5) / 100_000 * exposure - exposure
    mean = np.exp(2j * np.pi * frequency * times).mean()
    assert ocisac.exposure_response(frequency, exposure) == pytest.approx(mean, abs=1e-9)


def test_nulls_are_exact_and_the_sign_is_kept():
    np.testing.assert_array_equal(ocisac.exposure_response([1.0, 2.0, 1e6], 1.0), 0)
    assert ocisac.exposure_response(0.0, 1.0) == 1
    past_the_null = ocisac.exposure_response(1.5, 1.0)  # sinc < 0, and three quarters of a turn of delay
    assert past_the_null == pytest.approx(-2 / (3 * np.pi) * np.exp(-1.5j * np.pi))


@pytest.mark.parametrize("exposure", [0.0, 1e-5, 400e-6, 2404e-6, 4981e-6])
@pytest.mark.parametrize("max_boost", [1.5, 10.0, 100.0])
def test_lost_frequencies_agree_with_the_reference(exposure, max_boost):
    camera = Camera(22.2e-6, exposure)
    got, want = (of.lost_frequencies(camera, max_boost=max_boost) for of in (tones, reference))
    assert got.shape == want.shape
    np.testing.assert_allclose(got, want, rtol=1e-9)


def test_a_camera_is_a_frozen_value():
    camera = Camera(22.2e-6, 622e-6, 1 / 30, tone_curve="srgb", dark_level=16, white_level=235)
    assert pickle.loads(pickle.dumps(camera)) == camera
    assert hash(camera) == hash(Camera(22.2e-6, 622e-6, 1 / 30, tone_curve="srgb", dark_level=16, white_level=235))
    with pytest.raises(AttributeError):
        camera.row_time = 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"row_time": 0.0}, "row_time: got 0, allowed: a finite number above 0"),
        ({"row_time": float("nan")}, "row_time: got nan"),
        ({"exposure": -1e-6}, "exposure: got -1e-06, allowed: a finite number, 0 or above"),
        ({"exposure": float("inf")}, "exposure: got inf"),
        ({"frame_time": 0.0}, "frame_time: got 0"),
        ({"tone_curve": "log"}, "tone_curve: got log, allowed: linear, gamma or srgb"),
        ({"gamma": 0.0}, "gamma: got 0"),
        ({"dark_level": float("nan")}, "dark_level: got nan"),
        ({"dark_level": 16.0, "white_level": 16.0}, "white_level: got 16, allowed: a finite number above dark_level"),
    ],
)
def test_values_without_meaning_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        Camera(**({"row_time": 1e-5} | change))


@pytest.mark.parametrize(("frequency", "exposure"), [(np.nan, 1.0), (np.inf, 1.0), (1.0, -1.0), (1.0, np.nan)])
def test_response_refuses_what_has_no_meaning(frequency, exposure):
    with pytest.raises(ValueError, match="got"):
        ocisac.exposure_response(frequency, exposure)
