"""Harmonics of square waves above half the row rate, and those that fall onto the mean or the fundamental."""

import numpy as np
import pytest

from ocisac_fast import Camera, Flag, SquareWave, integrate_exposure, tone_gain

ROW_TIME, ROWS = 22.2e-6, 1080


def errors(cycles_per_row, random, noise, known):
    """(gain - theory)/gain_std in eight columns, and which have a flag."""
    frequency, duty = cycles_per_row / ROW_TIME, random.choice([0.1, 0.3, 0.5, 0.7])
    camera = Camera(ROW_TIME, exposure=random.uniform(0.05, 0.8) / frequency)
    light = integrate_exposure(SquareWave(frequency, phase=random.uniform(0, 6), duty=duty), camera, np.arange(ROWS))
    columns = 100 * light[:, None] + noise * random.standard_normal((ROWS, 8))
    told = camera if known else Camera(ROW_TIME)
    found = tone_gain(columns.astype(np.float32), told, frequency, waveform="square", duty=duty)
    flagged = (found.flags & ~np.uint32(Flag.WEAK | Flag.NEAR_NULL)) != 0
    return (found.gain - abs(np.sinc(frequency * camera.exposure))) / found.gain_std, flagged


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(("noise", "most_flagged"), [(0.5, 0.12), (2.0, 0.06)])
def test_any_square_wave_is_read_with_its_error_and_seldom_flagged(known, noise, most_flagged):
    every = [errors(r.uniform(0.02, 0.49), r, noise, known) for r in map(np.random.default_rng, range(150))]
    error, flagged = (np.concatenate(each) for each in zip(*every, strict=True))
    assert flagged.mean() <= most_flagged
    assert np.sqrt(np.mean(error[~flagged] ** 2)) < 1.1
    assert np.abs(error[~flagged]).max() < 4.5


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("near", [1 / 10, 1 / 6, 1 / 5, 1 / 4, 1 / 3, 2 / 5])
def test_harmonics_that_fall_together_are_flagged_where_they_bias(known, near):
    for seed in range(30):
        random = np.random.default_rng([seed, 2])
        error, flagged = errors(
            near + random.choice([0, 2e-5, 2e-4, 2e-3]) * random.standard_normal(), random, 1, known
        )
        assert not (np.abs(error[~flagged]) > 4.5).any()
