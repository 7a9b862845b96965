"""Simulated frames of a light: each impairment against its equation."""

import math

import numpy as np
import pytest

from ocisac_fast import Camera, Chips, Tone, integrate_exposure
from ocisac_fast.scene import Disc, Pinhole, Pose, Scene, Sensor, Source, render
from ocisac_fast.scene.simulation import lamp_bar, simulate_frames, texture

ROWS, COLUMNS = 400, 48
CAMERA = Camera(22.2e-6, 622e-6, frame_time=1 / 30)
LIGHT = Chips("0110100111", 8e3, repeat=True, rise=0.5, fall=0.3)


def frames_of(light=LIGHT, frames=3, **options):
    return np.array(list(simulate_frames(light, CAMERA, ROWS, COLUMNS, frames, dtype=np.float64, **options)))


def delays(frames, frequency):
    """Time by which each frame of a tone starts late, from the phase of a least-squares fit; and its residual."""
    ends = np.arange(frames.shape[1]) * CAMERA.row_time
    angles = 2 * np.pi * frequency * (ends - CAMERA.exposure / 2)
    model = np.stack([np.ones(ends.size), np.cos(angles), np.sin(angles)], axis=1)
    fitted, left, _, _ = np.linalg.lstsq(model, frames.mean(axis=2).T, rcond=None)
    phase = np.arctan2(-fitted[2], fitted[1]) - 2 * np.pi * frequency * np.arange(len(frames)) * CAMERA.frame_time
    return (phase + np.pi) % (2 * np.pi) / (2 * np.pi * frequency) - 1 / (2 * frequency), left


def test_light_hum_lamp_and_texture_make_the_pixels():
    lamp, wall = lamp_bar(ROWS, COLUMNS, 9.0, tilt=0.02), texture(ROWS, COLUMNS, 0.3, seed=5)
    hum = Tone(100.0, amplitude=0.5)
    got = frames_of(swing=80.0, dark_level=7.0, lamp=lamp, reflectance=wall, ambient=hum)
    p, h = (integrate_exposure(light, CAMERA, ROWS, frames=3)[:, :, None] for light in (LIGHT, hum))
    np.testing.assert_allclose(got, 7 + 80 * wall * (lamp * p + h), atol=1e-10)


def test_hum_has_its_peak_to_peak_over_the_swing_before_the_exposure():
    got = frames_of(Tone(0.0, amplitude=0.0), 1, swing=80.0, ambient=Tone(100.0, amplitude=0.5))
    assert np.ptp(got) == pytest.approx(0.5 * 80 * np.sinc(100 * CAMERA.exposure), rel=1e-3)


def test_frames_start_late_and_early_by_the_jitter():
    jitter = 50e-6
    got = frames_of(Tone(700.0), 300, jitter=jitter, seed=3)
    late, left = delays(got, 700.0)
    assert left.max() < 1e-15 * 200**2 * ROWS  # a tone that moved as a whole
    assert np.abs(late).max() <= jitter
    assert late.std() == pytest.approx(jitter / math.sqrt(3), rel=0.1)
    assert abs(late.mean()) < 4 * jitter / math.sqrt(3 * 300)
    assert abs(np.corrcoef(late[1:], late[:-1])[0, 1]) < 0.2
    np.testing.assert_array_equal(got[:3], frames_of(Tone(700.0), 3, jitter=jitter, seed=3))


def test_jitter_leaves_the_noise_as_it_is():
    still, moved = (frames_of(Tone(0.0), noise=2.0, seed=4, jitter=jitter) for jitter in (0.0, 1e-4))
    np.testing.assert_array_equal(still, moved)


def test_a_bar_has_its_width_and_tilt():
    bar = lamp_bar(1080, 320, 16.0, tilt=math.radians(10))
    columns = np.arange(320)
    centres = bar @ columns / bar.sum(axis=1)
    widths = np.sqrt(bar @ columns**2 / bar.sum(axis=1) - centres**2)
    inside = slice(400, 680)
    np.testing.assert_allclose(np.diff(centres[inside]), math.tan(math.radians(10)), rtol=1e-6)
    np.testing.assert_allclose(widths[inside], 16.0, rtol=1e-6)
    assert centres[539:541].mean() == pytest.approx(159.5)
    assert bar.max() == pytest.approx(1.0, abs=1e-3)


def test_texture_has_its_contrast_and_scales():
    logs = np.array([np.log(texture(720, 640, 0.3, seed=seed)) for seed in range(12)])
    assert logs.std() == pytest.approx(0.3, rel=0.05)
    # autocorrelation of white noise smoothed by a Gaussian of s px: exp(-d^2 / (4 s^2))
    for distance in (4, 12, 40):
        want = sum(share * math.exp(-(distance**2) / (4 * scale**2)) for scale, share in ((8, 0.2), (40, 0.8)))
        for axis in (1, 2):
            got = np.mean(logs * np.roll(logs, distance, axis)) / np.mean(logs**2)
            assert got == pytest.approx(want, abs=0.06)


def test_a_scene_has_slow_lights_and_jitter():
    lens = Pinhole(columns=8, rows=200, focal_length=4e-3, pixel_pitch=1e-5)
    source = Source(Disc(0.5), Pose((0, 0, 0.3)), LIGHT)
    exact = integrate_exposure(LIGHT, CAMERA, 200, frames=2)
    sensor = Sensor(200 / 622e-6)
    (still, _) = render(Scene(lens, CAMERA, sensor, sources=[source]).plan(tolerance=1e-3, frames=2))
    np.testing.assert_allclose(still, 200 * np.repeat(exact[0][:, None], 8, axis=1), atol=2e-3)
    tone = Source(Disc(0.5), Pose((0, 0, 0.3)), Tone(700.0))
    jittery = Scene(lens, CAMERA, Sensor(200 / 622e-6, frame_jitter=50e-6), sources=[tone])
    frames = np.array(list(render(jittery.plan(tolerance=1e-3, frames=50), seed=2)))
    late, left = delays(frames, 700.0)
    assert left.max() < 1e-4
    assert 30e-6 < np.abs(late).max() <= 50.1e-6
    assert late.std() == pytest.approx(50e-6 / math.sqrt(3), rel=0.25)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"jitter": -1.0}, "jitter: got -1"),
        ({"lamp": np.ones((3, 3))}, "lamp: got shape"),
        ({"reflectance": np.nan}, "reflectance: got values that are not finite"),
        ({"noise": np.inf}, "noise: got inf"),
        ({"frames": 0}, "frames: got 0"),
        (lambda: lamp_bar(10, 10, 3.0, tilt=2.0), "tilt: got 2"),
        (lambda: lamp_bar(10, 10, 0.0), "width: got 0"),
        (lambda: texture(10, 10, -1.0), "contrast: got -1"),
    ],
)
def test_values_without_meaning_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        options() if callable(options) else frames_of(**options)
