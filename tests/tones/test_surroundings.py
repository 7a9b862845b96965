"""Gains in company: other tones, distortion and clipped black."""

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera, Flag, SquareWave, Tone, integrate_exposure

ROW_TIME, ROWS, FREQUENCY, EXPOSURE = 22.2e-6, 1080, 500.0, 622e-6
CAMERA = Camera(ROW_TIME, exposure=EXPOSURE, dark_level=16)
THEORY = float(np.sinc(FREQUENCY * EXPOSURE))


def lamp(random, swing=100.0, frequency=FREQUENCY, columns=24):
    """Light of a square wave, DN, (rows, columns)."""
    wave = SquareWave(frequency, phase=random.uniform(0, 2 * np.pi))
    light = integrate_exposure(wave, CAMERA, np.arange(ROWS))
    return swing * light[:, None] * np.linspace(0.6, 1, columns)


def tone(random, frequency, peak_to_peak):
    """An additive tone of that mean, DN, (rows, 1)."""
    angle = 2 * np.pi * frequency * ROW_TIME * np.arange(ROWS) + random.uniform(0, 2 * np.pi)
    return peak_to_peak / 2 * (1 - np.sinc(frequency * EXPOSURE) * np.cos(angle))[:, None]


def stored(light, random, dark=16.0, noise=2.0):
    return np.clip(np.rint(light + dark + noise * random.standard_normal(light.shape)), 0, 255).astype(np.uint8)


def square_gain(pixels, **options):
    return ocisac.tone_gain(pixels, CAMERA, FREQUENCY, waveform="square", method="robust", **options)


@pytest.mark.parametrize("frequencies", [(100.0,), (120.0,), (100.0, 200.0), (730.0,), (300.0, 2345.0)])
@pytest.mark.parametrize("level", [0.02, 0.1, 0.5])
def test_other_tones_are_fitted_and_the_standard_error_covers_the_truth(frequencies, level):
    errors = []
    for seed in range(12):
        random = np.random.default_rng(seed)
        light = lamp(random) + sum(tone(random, f, 100 * level) for f in frequencies)
        found = square_gain(stored(light, random), background=50 * level * len(frequencies))
        assert not found.flags.any()
        errors.append((found.gain - THEORY) / found.gain_std)
    assert np.sqrt(np.mean(np.square(errors))) < 1.3  # 1 for independent columns; they share the frequencies' errors
    assert np.abs(np.median(errors, axis=1)).max() < 2


def test_hum_of_half_the_frequency_is_no_sideband_of_the_light():
    """A light that varies along the rows shows f - d beside d: one tone at half of f is not both."""
    frequency = 3.75 / (ROWS * 20e-6)
    camera = Camera(20e-6, exposure=0.1 / frequency)
    for seed in range(8):
        random = np.random.default_rng(seed)
        waves = [Tone(f, phase=random.uniform(0, 2 * np.pi)) for f in (frequency, 100.0)]
        light, hum = (integrate_exposure(wave, camera, ROWS) for wave in waves)
        pixels = stored(160 * (light + 0.3 * hum)[:, None] * np.linspace(0.5, 1, 8), random, dark=0.0, noise=1.0)
        found = ocisac.tone_gain(pixels, camera, frequency, method="robust", pooled=True)
        assert not found.flags.any()
        assert abs(found.gain - np.sinc(0.1) / 1.3) < 4 * found.gain_std


def test_a_tone_within_a_cycle_of_the_light_is_flagged():
    for seed in range(5):
        random = np.random.default_rng(seed)
        found = square_gain(stored(lamp(random) + tone(random, 520.0, 12), random), background=6)
        assert (found.flags == Flag.MODEL_MISFIT).all()


@pytest.mark.parametrize("exposure", [60e-6, 622e-6, 1202e-6])
def test_a_tone_curve_that_was_not_told_is_flagged(exposure):
    camera = Camera(ROW_TIME, exposure=exposure)
    random = np.random.default_rng(3)
    light = integrate_exposure(SquareWave(FREQUENCY, phase=0.3), camera, np.arange(ROWS))[:, None]
    pixels = stored(255 * (0.1 + 0.6 * light * np.ones(24)) ** 0.45, random, 0)
    found = ocisac.tone_gain(pixels, camera, FREQUENCY, waveform="square", method="robust", background=25.5)
    assert (found.flags == Flag.MODEL_MISFIT).all()


@pytest.mark.parametrize(("duty", "wave"), [(0.5, Tone), (0.3, Tone), (0.3, SquareWave), (0.45, SquareWave)])
@pytest.mark.parametrize("exposure", [0.05, 0.4, 0.6])
@pytest.mark.parametrize("pooled", [False, True])
def test_harmonics_that_are_not_those_of_the_square_wave_stated_are_flagged(duty, wave, exposure, pooled):
    """The fit has room for all harmonics, so that its residual is that of the right waveform."""
    frequency, random = 700.0, np.random.default_rng(5)
    camera = Camera(ROW_TIME, exposure=exposure / frequency, dark_level=16)
    light = integrate_exposure(wave(frequency, phase=random.uniform(0, 2 * np.pi)), camera, 720)
    pixels = stored((4 + 60 * light)[:, None] * np.linspace(0.6, 1, 32), random, noise=1.0)

    def read(**options):
        return ocisac.tone_gain(pixels, camera, frequency, waveform="square", pooled=pooled, **options)

    wrong = read(duty=duty)
    assert np.all((wrong.flags & Flag.MODEL_MISFIT != 0) | (abs(wrong.gain - np.sinc(exposure)) < 5 * wrong.gain_std))
    assert np.mean(wrong.flags & Flag.MODEL_MISFIT != 0) > 0.9 or wave is SquareWave
    if wave is SquareWave:
        assert not read(background=4 * np.linspace(0.6, 1, 32)).flags.any()


@pytest.mark.parametrize("duty", [0.5, 0.3])
def test_square_waves_of_other_phases_side_by_side_are_no_other_waveform(duty):
    frequency, random = 700.0, np.random.default_rng(8)
    camera = Camera(ROW_TIME, exposure=0.1 / frequency)
    phases = random.uniform(0, 2 * np.pi, 40)
    light = [integrate_exposure(SquareWave(frequency, duty=duty, phase=phase), camera, 720) for phase in phases]
    pixels = stored(10 + 180 * np.transpose(light), random)
    for options in ({}, {"method": "robust"}):
        found = ocisac.tone_gain(pixels, camera, frequency, waveform="square", duty=duty, background=26, **options)
        assert not found.flags.any()
        assert np.all(abs(found.gain - np.sinc(0.1)) < 5 * found.gain_std)
        wrong = ocisac.tone_gain(pixels, camera, frequency, waveform="square", duty=duty - 0.1, **options)
        assert (wrong.flags & Flag.MODEL_MISFIT != 0).all()


@pytest.mark.parametrize("method", ["fit", "robust"])
def test_columns_of_another_waveform_beside_right_ones_are_flagged(method):
    """Merged exposures show what the long one clips in a column or two at their levels of the short one."""
    frequency, wrong = 700.0, [40, 52]
    camera = Camera(ROW_TIME, exposure=0.33 / frequency, dark_level=16)
    for seed in range(10):
        random = np.random.default_rng(seed)
        light = integrate_exposure(SquareWave(frequency, phase=random.uniform(0, 2 * np.pi)), camera, 1080)[:, None]
        level = 45 * light * np.linspace(1, 0.8, 64)
        level[:, wrong] = np.where(light > 0.9, 20, 60 * light)
        pixels = stored(level, random, noise=0.7)
        found = ocisac.tone_gain(pixels, camera, frequency, waveform="square", method=method)
        is_wrong = np.isin(np.arange(64), wrong)
        assert (found.flags[is_wrong] & Flag.MODEL_MISFIT != 0).all()
        assert not (found.flags[~is_wrong] & Flag.MODEL_MISFIT).any()


def test_what_is_no_tone_beside_the_light_changes_nothing():
    """A lamp in part of the rows, a gradient, a drifting lamp: their sidebands are not fitted, nothing is flagged."""
    row = np.linspace(-1, 1, ROWS)[:, None]
    fading = 1 - 0.3 * (row + 1) / 2, np.exp(-0.5 * (row / 0.4) ** 2)
    for profile in (abs(row) < 0.3, abs(row) < 0.5, *fading, 1 + 0 * row):
        for seed in (*range(12), 834):
            random = np.random.default_rng(seed)
            found = square_gain(stored(lamp(random) * profile, random))
            assert not found.flags.any()
            assert np.abs(np.median((found.gain - THEORY) / found.gain_std)) < 2


def test_harmonics_of_a_light_fitted_as_a_tone_are_no_tones_beside_it():
    random = np.random.default_rng(5)
    pixels = stored(lamp(random), random)
    found = ocisac.tone_gain(pixels, CAMERA, FREQUENCY, method="robust")
    assert (found.flags == Flag.MODEL_MISFIT).all()
    np.testing.assert_allclose(found.gain * np.pi / 4, THEORY, rtol=0.02)


@pytest.mark.parametrize("lost", [0.0, 2.0, 8.0])
def test_clipping_at_black_is_flagged_like_that_at_white(lost):
    random = np.random.default_rng(1)
    pixels = stored(lamp(random), random, dark=-lost)
    robust = {"waveform": "square", "method": "robust"}
    found = ocisac.tone_gain(pixels, Camera(ROW_TIME, exposure=EXPOSURE), FREQUENCY, **robust)
    assert (found.flags & Flag.SATURATED).all()
    few = stored(lamp(random), random, dark=6)  # 3 standard deviations of the noise above 0
    told = ocisac.tone_gain(few, Camera(ROW_TIME, exposure=EXPOSURE, dark_level=6), FREQUENCY, **robust)
    assert not told.flags.any()


def at_times(ends, phase, exposure=EXPOSURE):
    """Light of a square wave at rows that end their exposures at ``ends`` (in row times), DN, (rows, columns)."""
    fine = Camera(ROW_TIME / 8, exposure=exposure)
    light = integrate_exposure(SquareWave(FREQUENCY, phase=phase), fine, np.arange(8 * (ROWS + 100)))
    return np.interp(ends + 50, np.arange(light.size) / 8, light)[:, None] * np.linspace(60, 100, 24)


def read_unevenly(kind, random):
    """A frame in which something is wrong with some rows."""
    row, phase = np.arange(ROWS, dtype=float), random.uniform(0, 2 * np.pi)
    off_middle = row - ROWS / 2
    if kind == "pause":
        return at_times(row + random.uniform(8, 40) * (row > random.uniform(0.2, 0.8) * ROWS), phase)
    if kind == "pauses":
        return at_times(row + random.uniform(1, 4) * np.floor(row / random.integers(60, 200)), phase)
    if kind == "lens":
        return at_times(row + random.uniform(0.03, 0.08) * off_middle**3 / (ROWS / 2) ** 2, phase)
    light = at_times(row, phase)
    if kind == "lost slice":
        first, rows = random.integers(0, ROWS - 400), random.integers(100, 400)
        light[first : first + rows] = at_times(row, phase + random.uniform(1, 5))[first : first + rows]
    elif kind == "pairs of rows":
        ratio = random.uniform(2, 4)
        light[row // 2 % 2 == 1] = at_times(row, phase, EXPOSURE / ratio)[row // 2 % 2 == 1]
    elif kind == "streaks":
        for _ in range(6):
            first, column = random.integers(0, ROWS - 200), random.integers(0, 22)
            light[first : first + random.integers(60, 200), column : column + 3] += random.uniform(20, 60)
    return light


@pytest.mark.parametrize("kind", ["pause", "pauses", "lens", "lost slice", "pairs of rows", "streaks"])
def test_what_is_wrong_with_some_rows_is_flagged_and_nothing_else(kind):
    for seed in range(20):
        random = np.random.default_rng([seed, 7])
        clean = square_gain(stored(at_times(np.arange(ROWS), random.uniform(0, 6)), random))
        assert not clean.flags.any()
        found = square_gain(stored(read_unevenly(kind, random), random))
        wrong = np.abs(found.gain - THEORY) > 3 * found.gain_std
        assert (found.flags[wrong] & Flag.MODEL_MISFIT).all()
        if kind != "streaks":
            pooled = square_gain(stored(read_unevenly(kind, random), random), pooled=True)
            assert pooled.flags & Flag.MODEL_MISFIT or abs(pooled.gain - THEORY) < 3 * pooled.gain_std


def test_light_that_no_tone_of_this_exposure_makes_is_flagged():
    """A threshold, coarse steps, a curve that was not stated, a square wave, rows in a wrong order."""
    camera = Camera(22.2e-6, 300e-6)
    random = np.random.default_rng(3)
    noise = random.normal(0, 1, (720, 24))
    light = 200 * integrate_exposure(Tone(1500.0, phase=0.3), camera, 720)[:, None]
    square = 200 * integrate_exposure(SquareWave(1500.0), camera, 720)[:, None]
    tone = (light + noise).clip(0, 255).round().astype(np.uint8)
    assert not ocisac.tone_gain(tone, camera, 1500.0, method="robust").flags.any()
    beyond = [tone > 100, tone // 64 * 64, (255 * ((light + noise).clip(0) / 255) ** 1.3).round(), square + noise]
    for pixels in beyond:
        for method in ("fit", "robust"):
            for pooled in (False, True):
                found = ocisac.tone_gain(pixels, camera, 1500.0, method=method, pooled=pooled)
                assert (found.flags & np.uint32(Flag.MODEL_MISFIT)).all()
    gamma = 255 * ((light + noise).clip(0) / 255) ** 0.45
    swapped = tone.reshape(360, 2, 24)[:, ::-1].reshape(720, 24)
    for pixels in (gamma, swapped):
        for pooled in (False, True):
            found = ocisac.tone_gain(pixels, camera, 1500.0, method="robust", pooled=pooled)
            assert (found.flags == Flag.MODEL_MISFIT).all()
    assert (ocisac.tone_gain(tone // 64 * 64, camera, 1500.0).flags & np.uint32(Flag.QUANTISED)).all()


def test_a_dark_level_at_which_columns_have_no_light_is_flagged_in_their_mean():
    camera = Camera(22.2e-6, 300e-6)
    light = 200 * integrate_exposure(Tone(1500.0, phase=0.3), camera, 720)[:, None]
    pixels = (light + np.random.default_rng(1).normal(0, 1, (720, 60))).clip(0, 255).round() - light.mean()
    single, pooled = (ocisac.tone_gain(pixels, camera, 1500.0, pooled=pooled) for pooled in (False, True))
    assert (single.flags & np.uint32(Flag.NO_LIGHT)).any()
    assert (single.flags & np.uint32(Flag.MODEL_MISFIT)).all()
    assert int(pooled.flags) & (Flag.MODEL_MISFIT | Flag.NO_LIGHT)
