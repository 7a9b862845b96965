"""Clipped light is flagged at either end, at any level, in any type; other light is not."""

import numpy as np
import pytest

from ocisac_fast import Camera, Flag, SquareWave, Tone, _core, integrate_exposure, tone_gain

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
    if kind == "dark":  # as of limited range
        pixels = np.rint(stored).clip(np.ceil(dark - 0.5), 255).astype(np.uint8)
    elif kind == "white":
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


@pytest.mark.parametrize("kind", ["black", "dark", "white", "floor", "12 bits", "floats"])
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
    # Where few rows in a cycle are dark they are one run of them with noise and without.
    assert missed <= (0.4 if kind == "dark" else 0.05) * biased
    assert flagged <= 0.05 * right


@pytest.mark.parametrize("kind", ["black", "dark", "white", "floor", "12 bits", "floats"])
def test_pooled_columns_that_are_clipped_are_flagged_or_left_out(kind):
    biased, missed = 0, 0
    for seed in range(60):
        random, stored, camera, asked = draw([seed, 5])
        pixels, dark = clipped(kind, random, stored, camera.dark_level)
        truth = tone_gain(stored, camera, **asked, pooled=True)
        known = Camera(ROW_TIME, exposure=camera.exposure, dark_level=dark)
        found = tone_gain(pixels, known, **asked, pooled=True)
        wrong = abs(found.gain / truth.gain - 1) > 0.01
        biased, missed = biased + wrong, missed + (wrong and not found.flags & (Flag.SATURATED | Flag.MODEL_MISFIT))
    assert biased >= 5
    assert missed <= 0.05 * biased


def dim_lamp(waveform, swing, noise, black, seed):
    """200 columns of bytes, clipped at 0, and the gain's arguments."""
    random = np.random.default_rng([seed, 7])
    camera = Camera(ROW_TIME, exposure=50e-6, dark_level=black)
    wave = (SquareWave if waveform == "square" else Tone)(1000.0, phase=random.uniform(0, 6))
    light = swing * integrate_exposure(wave, camera, 720)[:, None] + black
    pixels = np.rint(light + noise * random.standard_normal((720, 200))).clip(0, 255).astype(np.uint8)
    return pixels, camera, {"frequency": 1000.0, "waveform": waveform}


@pytest.mark.parametrize("waveform", ["tone", "square"])
@pytest.mark.parametrize(
    ("swing", "noise", "black"),
    [(2.0, 8.0, 0.0), (4.0, 16.0, 0.0), (4.0, 24.0, 0.0), (8.0, 30.0, 0.0), (4.0, 16.0, 32.0), (4.0, 16.0, 40.0)],
)
def test_a_dim_lamp_below_noise_that_is_clipped_has_no_pooled_gain_without_a_flag(waveform, swing, noise, black):
    """Columns are weak, and at the dark level of 40 too few samples of each are at 0: all together are not."""
    for seed in range(4):
        pixels, camera, asked = dim_lamp(waveform, swing, noise, black, seed)
        assert tone_gain(pixels, camera, **asked, pooled=True).flags & Flag.SATURATED


@pytest.mark.parametrize("waveform", ["tone", "square"])
@pytest.mark.parametrize(("swing", "noise"), [(2.0, 0.5), (4.0, 0.5), (8.0, 0.5), (4.0, 0.4), (4.0, 0.6)])
def test_noise_of_half_a_step_that_is_clipped_at_black_is_flagged(waveform, swing, noise):
    """As many samples of a tone of two steps are at 1 as at 0: a third of its columns have no flag by themselves."""
    silent = 0
    for seed in range(4):
        pixels, camera, asked = dim_lamp(waveform, swing, noise, 0.0, seed)
        assert tone_gain(pixels, camera, **asked, pooled=True).flags & (Flag.SATURATED | Flag.QUANTISED)
        found = tone_gain(pixels, camera, **asked)
        truth = np.sinc(1000.0 * camera.exposure)
        silent += ((found.flags == 0) & (np.abs(found.gain - truth) > 3 * found.gain_std)).sum()
    assert silent <= (0.3 if swing == 2 and waveform == "tone" else 0.05) * 4 * 200


def test_a_bright_lamp_with_little_noise_above_black_has_no_flag():
    """Noise of a fifth of a step loses 0.6 % of the samples where the lamp is off: less than a standard error."""
    flagged = 0
    for seed in range(8):
        pixels, camera, asked = dim_lamp("square", 100.0, 0.2, 0.0, seed)
        assert not tone_gain(pixels, camera, **asked, pooled=True).flags & Flag.SATURATED
        flagged += (tone_gain(pixels, camera, **asked).flags & Flag.SATURATED != 0).mean() / 8
    assert flagged <= 0.05


@pytest.mark.parametrize(("level", "noise"), [(0.0, 0.6), (0.5, 1.0), (2.0, 1.0), (3.0, 4.0), (40.0, 4.0)])
def test_light_that_black_adds_is_that_of_rounded_and_cut_noise(level, noise):
    samples = np.rint(level + noise * np.random.default_rng(0).standard_normal(400_000))
    at, lost = (samples <= 0).mean(), np.maximum(samples, 0).mean() - samples.mean()
    assert at * _core.lost_at_black(level, noise, -1.0) == pytest.approx(lost, rel=0.03, abs=0.002)
    assert at * _core.lost_at_black(level, noise, level - 0.01) <= 0.0105


@pytest.mark.parametrize("method", ["fit", "robust"])
@pytest.mark.parametrize("waveform", ["tone", "square"])
def test_noise_that_black_cuts_is_a_part_of_the_error_of_a_pooled_gain(waveform, method):
    """Light of 1.5 steps, which the exposure leaves above black: no column shows a pile."""
    errors = []
    for seed in range(20):
        random = np.random.default_rng([seed, 11])
        camera, frequency = Camera(133e-6, exposure=1145e-6), 1000.0
        asked = {"frequency": frequency, "waveform": waveform, "pooled": True, "method": method}
        wave = SquareWave(frequency, phase=random.uniform(0, 6), duty=0.13) if waveform == "square" else Tone(frequency)
        if waveform == "square":
            asked["duty"] = 0.13
        light = integrate_exposure(wave, camera, 2160)
        light = 1.45 * (light / light.mean())[:, None] * random.uniform(0.3, 1, 64)
        pixels = np.rint(light + 0.887 * random.standard_normal(light.shape)).clip(0, 255).astype(np.uint8)
        found = tone_gain(pixels, camera, **asked)
        if not found.flags:
            errors.append((found.gain - abs(np.sinc(frequency * camera.exposure))) / found.gain_std)
    assert len(errors) >= 15
    assert np.abs(errors).max() < 4.5
    assert np.sqrt(np.mean(np.square(errors))) < 2


def test_a_lamp_that_is_off_without_noise_loses_nothing_at_black():
    """Noise that grows with the light is that of the bright rows; the dark ones have no light to lose."""
    for seed in range(10):
        random = np.random.default_rng([seed, 12])
        camera = Camera(ROW_TIME, exposure=300e-6)
        light = integrate_exposure(SquareWave(1000.0, phase=random.uniform(0, 6)), camera, ROWS)[:, None]
        light = 150 * light * random.uniform(0.5, 1, 64)
        stored = light + (0.1 + 0.1 * np.sqrt(light)) * random.standard_normal(light.shape)
        pixels = np.rint(stored).clip(0, 255).astype(np.uint8)
        found, truth = (
            tone_gain(each, camera, 1000.0, waveform="square", pooled=True)
            for each in (pixels, stored.astype(np.float32))
        )
        assert not found.flags
        assert found.gain_std < 3 * truth.gain_std  # 30 times as large if noise were alike in all rows


@pytest.mark.parametrize("peak", [6, 12, 40])
def test_black_that_adds_light_to_a_lamp_that_is_mostly_off_is_in_the_error(peak):
    """Noise of 0.3 steps about black can only be rounded up; a lamp's mean over few lit rows is far below its light."""
    beyond = unflagged = 0
    for seed in range(20):
        random = np.random.default_rng([seed, 13])
        frequency = random.uniform(900, 13000)
        camera = Camera(ROW_TIME, random.uniform(0.01, 0.3) / frequency)
        wave = SquareWave(frequency, phase=random.uniform(0, 6), duty=0.1)
        light = peak * integrate_exposure(wave, camera, 1080)[:, None] + 0.3 * random.standard_normal((1080, 16))
        pixels = np.rint(light).clip(0, 255).astype(np.uint8)
        found = tone_gain(pixels, camera, frequency, waveform="square", duty=0.1, pooled=True)
        if not found.flags:
            unflagged += 1
            beyond += abs(found.gain - np.sinc(frequency * camera.exposure)) > 5 * found.gain_std
    assert unflagged >= 12
    assert beyond <= 7  # 16 and more by the noise at twice the mean


@pytest.mark.parametrize("pooled", [True, False])
def test_light_far_below_the_dark_level_is_flagged_and_other_light_is_not(pooled):
    flagged = []
    for seed in range(60):
        _, stored, camera, asked = draw([seed, 6])
        pixels = np.rint(stored).clip(0, 255).astype(np.uint8)
        right = tone_gain(pixels, camera, **asked, pooled=pooled)
        wrong_flags = Flag.MODEL_MISFIT | (Flag.SATURATED if pixels.min() > 0 and pixels.max() < 240 else 0)
        assert not (right.flags & wrong_flags).any()
        column = tone_gain(stored[:, -1], camera, **asked)
        noise = column.gain * column.mean / np.sqrt(column.snr)
        dark = np.sort(stored[:, -1])[ROWS // 20] + 6 * noise
        if dark < stored[:, -1].mean():
            told = Camera(ROW_TIME, exposure=camera.exposure, dark_level=dark)
            wrong = tone_gain(pixels, told, **asked, pooled=pooled)
            flagged.append(((wrong.flags & (Flag.MODEL_MISFIT | Flag.NO_LIGHT)) != 0).all())
    assert len(flagged) > 30
    assert all(flagged)


@pytest.mark.parametrize("pooled", [True, False])
def test_twelve_bits_that_recur_after_few_rows_are_flagged(pooled):
    """The value beside the top is hundreds of steps below it: levels come again after few rows."""
    camera = Camera(20e-6, exposure=60e-6)
    light = integrate_exposure(Tone(1000.0, phase=0.3), camera, np.arange(600))[:, None] * np.ones(100)
    noise = np.random.default_rng(0).standard_normal(light.shape)
    pixels = (4800 * light + 16 * noise).clip(0, 4095).astype(np.uint16)
    assert (tone_gain(pixels, camera, 1000.0, pooled=pooled).flags == Flag.SATURATED).all()


def test_a_dark_lamp_without_noise_is_no_clipping():
    """Noise that grows with the light leaves samples equal where the lamp is off."""
    flagged = 0
    for seed in range(60):
        random = np.random.default_rng([seed, 99])
        frequency, duty = random.uniform(150, 3000), random.choice([0.3, 0.5, 0.7])
        camera = Camera(ROW_TIME, exposure=random.uniform(0.05, 0.4) / frequency, dark_level=random.uniform(5, 30))
        wave = SquareWave(frequency, phase=random.uniform(0, 6), duty=duty)
        light = integrate_exposure(wave, camera, np.arange(ROWS))[:, None] * np.linspace(0.6, 1, 24)
        light *= random.uniform(60, 180)
        spread = random.choice([0.05, 0.1, 0.2, 0.3]) + random.uniform(0.1, 0.4) * np.sqrt(light)
        stored = light + camera.dark_level + spread * random.standard_normal(light.shape)
        pixels = np.rint(stored).clip(0, 255).astype(np.uint8)
        found = tone_gain(pixels, camera, frequency, waveform="square", duty=duty)
        flagged += bool((found.flags & Flag.SATURATED).any())
    assert flagged <= 20


@pytest.mark.parametrize("convert", [np.float32, np.float64, lambda levels: levels / 255, lambda levels: levels > 1])
def test_rounding_is_flagged_in_samples_of_any_type(convert):
    """As pictures are converted: to floats, to 0 to 1, by a threshold."""
    light = 2 + 0.4 * np.cos(2 * np.pi * 700 * 22.2e-6 * np.arange(720))[:, None]
    levels = np.rint(light + np.random.default_rng(0).normal(0, 0.05, (720, 64))).astype(np.uint8)
    for pixels in (levels, convert(levels)):
        found = tone_gain(pixels, Camera(22.2e-6), 700.0, pooled=True)
        assert found.flags & (Flag.QUANTISED | Flag.WEAK | Flag.SATURATED)


@pytest.mark.parametrize(("top", "step", "noise"), [(1023, 1, 4), (1023, 12, 12), (1.0, 0, 0.004)])
def test_light_that_is_nearly_all_cut_off_is_clipped(top, step, noise):
    rows = np.arange(480)
    for seed in range(12):
        random, frequency = np.random.default_rng(seed), 300.0 + 120 * seed
        light = 1 + 0.12 * np.cos(2 * np.pi * frequency * 4e-5 * rows)[:, None]
        stored = (top + 1.5 * noise) * light / light.min() + noise * random.standard_normal((480, 200))
        stored = np.minimum(np.rint(stored / step) * step if step else stored, top)
        pixels = stored.astype(np.uint16 if step else np.float32)
        flags = tone_gain(pixels, Camera(4e-5), frequency, pooled=True).flags
        assert flags & (Flag.SATURATED | Flag.QUANTISED)


@pytest.mark.parametrize("level", [100.3, 100.6])
def test_a_faint_tone_of_two_steps_is_not_cut_off(level):
    """Most rows have the largest value, beside noise of less than half a step: that is rounding."""
    random, frequency = np.random.default_rng(3), 700.0
    light = level + 0.3 * np.cos(2 * np.pi * frequency * ROW_TIME * np.arange(480))[:, None]
    pixels = np.rint(light + random.normal(0, 0.1, (480, 32))).astype(np.uint8)
    assert (tone_gain(pixels, Camera(ROW_TIME), frequency).flags == Flag.QUANTISED).all()


def rounded_lamp(level, noise, seed):
    """Gains of 32 columns of square waves of 100 to 200 DN, cut off at a level, apart and pooled, and the true one."""
    random = np.random.default_rng(seed)
    camera = Camera(1.0, exposure=random.uniform(5, 15), dark_level=16)
    light = integrate_exposure(SquareWave(1 / 101.4, phase=random.uniform(0, 6), duty=0.52), camera, ROWS)
    stored = 16 + light[:, None] * random.uniform(100, 200, 32) + noise * random.standard_normal((ROWS, 32))
    pixels = np.rint(np.minimum(stored, level)).astype(np.uint8)
    apart, pooled = (
        tone_gain(pixels, camera, 1 / 101.4, waveform="square", duty=0.52, pooled=pooled) for pooled in (False, True)
    )
    return apart, pooled, abs(np.sinc(camera.exposure / 101.4))


@pytest.mark.parametrize("noise", [0.1, 0.3, 0.45])
def test_columns_of_different_light_that_share_a_level_are_clipped(noise):
    """Little noise makes a pile of each column's own crest; one level for all of them is that of the camera."""
    saturated, flagged = [], []
    for seed in range(20):
        clipped, pooled, gain = rounded_lamp(170, noise, seed)
        assert pooled.flags & (Flag.SATURATED | Flag.QUANTISED) or abs(pooled.gain.item() - gain) < 5 * pooled.gain_std
        saturated.append((clipped.flags & Flag.SATURATED) != 0)
        flagged.append((rounded_lamp(250, noise, seed)[0].flags & Flag.SATURATED) != 0)
    assert np.mean(saturated) > 0.25
    assert np.mean(flagged) < 0.02


@pytest.mark.parametrize("pooled", [False, True])
def test_dark_rows_that_round_alike_beside_noise_of_the_light_are_flagged(pooled):
    """Rows that see no lamp are 0.4 of a step off, all of them; noise of the read-out as large as a step hides that."""
    for seed in range(6):
        random = np.random.default_rng([seed, 5])
        frequency, camera = random.uniform(5, 20) / (ROWS * ROW_TIME), Camera(ROW_TIME, 50e-6, dark_level=16.4)
        wave = SquareWave(frequency, phase=random.uniform(0, 6))
        light = integrate_exposure(wave, camera, ROWS)[:, None] * random.uniform(70, 120, 60)
        shot = random.choice([0.1, 0.2]) * np.sqrt(light) * random.standard_normal(light.shape)
        for read in (0.0, 1.0):
            noise = shot + read * random.standard_normal(light.shape)
            pixels = np.rint(16.4 + light + noise).clip(0, 255).astype(np.uint8)
            flags = tone_gain(pixels, camera, frequency, waveform="square", pooled=pooled).flags
            assert np.mean((flags & Flag.QUANTISED) != 0) == (read == 0.0), (seed, read)


@pytest.mark.parametrize("noise", [0.6, 1.2, 2.0])
def test_noise_cut_off_in_the_few_dark_rows_of_any_period_is_seen(noise):
    """One or two rows of 30 are dark; rows at multiples of the golden ratio see four phases of that period."""
    exposure = 300e-6
    for turns in (0.43, 0.45, 0.47):
        frequency, camera = turns / exposure, Camera(ROW_TIME, exposure, dark_level=0)
        for seed in range(8):
            random = np.random.default_rng(seed)
            light = integrate_exposure(SquareWave(frequency, phase=random.uniform(0, 6)), camera, ROWS)[:, None]
            stored = 60 * light * random.uniform(0.8, 1, 100) + noise * random.standard_normal((ROWS, 100))
            pixels = np.rint(stored).clip(0, 255).astype(np.uint8)
            found = tone_gain(pixels, camera, frequency, waveform="square", pooled=True)
            error = abs(float(found.gain) - np.sinc(turns))
            assert int(found.flags) & Flag.SATURATED or error < 5 * found.gain_std, (turns, seed)
