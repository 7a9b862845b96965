"""Means over frames: errors that hold for noise and for frames that differ."""

import numpy as np
import pytest

from ocisac_fast.core.statistics import do_differ, mean_and_std


@pytest.mark.parametrize("frames", [2, 5, 40])
def test_noise_has_the_error_that_its_frames_state(frames):
    random = np.random.default_rng(frames)
    spreads = random.uniform(0.001, 0.004, (4000, frames))
    values = 0.7 + spreads * random.standard_normal(spreads.shape)
    found = [mean_and_std(*one) for one in zip(values, spreads, strict=True)]
    pulls = np.array([(mean - 0.7) / std for mean, std in found])
    assert np.std(pulls) == pytest.approx(1, abs=0.05)
    stated = np.sqrt(1 / (1 / spreads**2).sum(axis=1))
    assert np.mean([std > 1.001 * own for (_, std), own in zip(found, stated, strict=True)]) < 0.01
    assert not any(do_differ(*one) for one in zip(values, spreads, strict=True))


def test_frames_that_differ_widen_the_error():
    values, spreads = np.array([0.64] * 4 + [0.27] * 4), np.full(8, 1e-5)
    mean, std = mean_and_std(values, spreads)
    assert (mean, std) == pytest.approx((values.mean(), values.std(ddof=1) / np.sqrt(8)))
    assert do_differ(values, spreads)
    assert not do_differ(values, np.full(8, 0.2))


def test_frames_without_a_result_count_for_nothing():
    mean, std = mean_and_std(np.array([0.5, np.nan, 0.5]), np.array([0.01, np.nan, 0.01]))
    assert (mean, std) == pytest.approx((0.5, 0.01 / np.sqrt(2)))
    assert np.isnan(mean_and_std(np.array([np.nan]), np.array([np.nan]))).all()
    assert not do_differ(np.array([np.nan]), np.array([np.nan]))
