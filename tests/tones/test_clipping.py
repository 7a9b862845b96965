"""Clipped light is flagged at either end, at any level, in any type; other light is not."""

import numpy as np
import pytest

from ocisac_fast import Camera, Flag, SquareWave, Tone, integrate_exposure, tone_gain

ROW_TIME, ROWS = 22.2e-6, 1080


def draw(seed):
    """A lamp in 24 columns with noise, DN, (rows, columns), its camera and how its gain is asked for."""
    random = np.random.default_rng(seed)
    frequency = random.uniform(150, 6000)
    camera = Camera(ROW_TIME, exposure=random.uniform(0.05, 0.9) / frequency, dark_level=random.uniform(5, 30))
    waveform, duty = random.choice(["tone", "square"]), random.choice([0.3, 0.5, 0.7])
    phase = random.uniform(0, 6)
    wave = Tone(frequency, phase=phase) if waveform == "tone" else SquareWave(frequency, phase=phase, duty=duty)
    light = integrate_exposure(wave, camera, np.arange(ROWS))[:, None] * np.linspace(0.6, 1, 24)
    noise = random.choice([1.0, 2.0, 4.0]) * random.standard_normal((ROWS, 24))
    stored = random.uniform(60, 180) * light + camera.dark_level + noise
    return random, stored, camera, {"frequency": frequency, "waveform": waveform, "duty": duty}


def clipped(kind, random, stored, dark):
    """Pixels and their dark level."""
    swing, scale = np.ptp(stored), 1.0
    if kind == "black":  # the lower part of the noise of the dark lamp is lost
        offset = random.uniform(-0.2, 4)
        return np.rint(stored - dark + offset).clip(0, 255).astype(np.uint8), offset
    if kind == "white":
        pixels = np.rint(stored).clip(0, np.floor(stored.max() - random.uniform(-0.5, 0.4) * swing)).astype(np.uint8)
    elif kind == "floor":
        pixels = np.rint(stored).clip(np.ceil(stored.min() + random.uniform(-0.5, 0.4) * swing), 255).astype(np.uint8)
    elif kind == "12 bits":
        scale = 4095 / (stored.max() * random.uniform(0.7, 1.2))
        pixels = np.rint(stored * scale).clip(0, 4095).astype(">u2" if random.random() < 0.5 else np.uint16)
    else:
        scale = 1 / 255
        pixels = (stored * scale).clip(0, random.uniform(0.6, 1.2) * stored.max() * scale).astype(np.float32)
    return pixels, dark * scale


@pytest.mark.parametrize("kind", ["black", "white", "floor", "12 bits", "floats"])
def test_clipping_that_shifts_a_gain_is_flagged_and_other_light_is_not(kind):
    biased, missed, right, flagged = 0, 0, 0, 0
    for seed in range(60):
        random, stored, camera, asked = draw([seed, 3])
        pixels, dark = clipped(kind, random, stored, camera.dark_level)
        found = tone_gain(pixels, Camera(ROW_TIME, exposure=camera.exposure, dark_level=dark), **asked)
        truth = tone_gain(stored, camera, **asked)
        error = np.abs(found.gain - truth.gain) / truth.gain_std
        saturated = (found.flags & Flag.SATURATED) != 0
        known = (truth.flags == 0) & (found.flags & ~np.uint32(Flag.SATURATED) == 0)
        biased, missed = biased + (known & (error > 3)).sum(), missed + (known & (error > 3) & ~saturated).sum()
        right, flagged = right + (known & (error < 0.5)).sum(), flagged + (known & (error < 0.5) & saturated).sum()
    assert biased > 40
    assert missed <= 0.05 * biased
    assert flagged <= 0.05 * right


def test_light_without_clipping_has_no_flag():
    for seed in range(60):
        _, stored, camera, asked = draw([seed, 4])
        pixels = np.rint(stored).clip(0, 255).astype(np.uint8)
        if pixels.min() > 0 and pixels.max() < 240:
            found = tone_gain(pixels, camera, **asked)
            assert not (found.flags & Flag.SATURATED).any()
