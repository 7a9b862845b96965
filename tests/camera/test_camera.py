"""The camera and the exposure's response."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import ocisac_fast as ocisac
from ocisac_fast import Camera, reference
from ocisac_fast.camera.linear_light import light_per_step, linear_light, saturation_level, stored_values
from ocisac_fast.reference.camera import saturation_level as reference_saturation_level


@settings(deadline=None, max_examples=3 * settings.default.max_examples // 5)
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


@pytest.mark.parametrize("curve", [("linear", 2.2), ("gamma", 1.8), ("srgb", 2.2), ("hlg", 2.2), ("pq", 2.2)])
@pytest.mark.parametrize("levels", [(0.0, None), (16.0, 235.0)])
@pytest.mark.parametrize("dtype", [np.uint8, np.float64])
def test_tone_curves_agree_with_the_reference_and_invert(curve, levels, dtype):
    if dtype is np.float64 and levels[1] is None:
        levels = (0.0, 1.0)
    camera = Camera(22.2e-6, tone_curve=curve[0], gamma=curve[1], dark_level=levels[0], white_level=levels[1])
    stored = np.arange(256).astype(np.uint8) if dtype is np.uint8 else np.linspace(-0.1, 1.1, 500) * (levels[1] or 1.0)
    light = linear_light(stored, camera)
    np.testing.assert_allclose(light, reference.linear_light(stored, camera), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(stored_values(light, camera, dtype), stored, rtol=1e-6, atol=1e-6)
    step, span = 1e-4, (levels[1] or 255.0) - levels[0]
    middle = levels[0] + span * np.linspace(0.1, 1.0, 20)
    full = Camera(22.2e-6, tone_curve=curve[0], gamma=curve[1], dark_level=levels[0], white_level=levels[0] + span)
    slope = (linear_light(middle + step * span, full) - linear_light(middle - step * span, full)) / (2 * step * span)
    np.testing.assert_allclose(light_per_step(middle, full), np.maximum(slope, 0.02), rtol=1e-5)


def test_curves_of_high_dynamic_range_have_the_values_of_bt_2100():
    values = np.array([0.25, 0.5, 0.75, 1.0, 5.0])  # of HLG: sqrt(3 E) below, and the reference white of BT.2408
    hlg, pq = (Camera(None, tone_curve=curve, white_level=1.0) for curve in ("hlg", "pq"))
    light = linear_light(values, hlg)
    np.testing.assert_allclose(light[:4], [0.25**2 / 3, 1 / 12, 0.265, 1.0], rtol=1e-3)
    stated = linear_light(np.array([0.508, 0.581, 0.752, 1.0]), pq)
    np.testing.assert_allclose(stated * 1e4, [100, 203, 1000, 1e4], rtol=0.01)
    for camera in (hlg, pq):  # 16-bit samples of limited range can be far above white
        np.testing.assert_allclose(stored_values(linear_light(values, camera), camera, np.float64), values)


@pytest.mark.parametrize(("dark", "white"), [(0.0, None), (16.0, 235.0)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_all_rooms_have_one_saturation_level(dark, white, dtype):
    camera = Camera(22.2e-6, dark_level=dark, white_level=white)
    level = saturation_level(camera, dtype)
    np.testing.assert_equal(level, reference_saturation_level(np.zeros(1, dtype), camera))
    if white is None and dtype is np.float32:
        return
    row = np.arange(400.0)[:, None]
    for peak, flagged in ((np.ceil(level), True), (np.ceil(level) - 1.0, False)):
        swing = 0.2 * peak * (np.cos(2 * np.pi * 0.02 * row) - 1.0)  # a sample of row 0 is at the peak
        frame = np.broadcast_to(peak + swing, (400, 4)).astype(dtype)
        gain = ocisac.tone_gain(frame, camera, 0.02 / 22.2e-6, waveform="tone")
        assert np.all((gain.flags & ocisac.Flag.SATURATED != 0) == flagged)
