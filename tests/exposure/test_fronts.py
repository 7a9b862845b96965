"""Fronts between communication and sensing, and their picture."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ocisac_fast.exposure import best_noisy_exposure, exposure_front


def test_noise_without_bound_leaves_no_signal() -> None:
    assert not exposure_front(500.0, 120.0, noise_exposure=1e-320).comm.any()


def test_no_exposure_beats_an_efficient_one() -> None:
    front = exposure_front(500.0, 350.0, points=401)
    for k in range(front.exposure.size):
        better = (front.comm >= front.comm[k]) & (front.sense >= front.sense[k])
        better &= (front.comm > front.comm[k]) | (front.sense > front.sense[k])
        assert front.efficient[k] == (not better.any())


@pytest.mark.parametrize("noise", [math.inf, 3e-4])
def test_ours_is_on_the_front_and_the_best_of_any_weights(noise: float) -> None:
    random = np.random.default_rng(4)
    for _ in range(20):
        f = np.exp(random.uniform(np.log(100), np.log(3000), 2))
        weights = np.exp(random.uniform(-5, 5, 2))
        longest = 1.0 / f.min()
        front = exposure_front(*f, noise_exposure=noise, points=200_001)
        sums = weights[0] * front.comm + weights[1] * front.sense
        best = best_noisy_exposure(f, weights, (1e-9, longest), noise_exposure=noise)
        assert best.objective >= sums.max() * (1 - 1e-12)
        assert best.objective <= sums.max() * (1 + 1e-7)  # the grid misses the peak
        near = np.linspace(best.exposure * (1 - 1e-4), min(best.exposure * (1 + 1e-4), longest), 20_001)
        around = weights @ (near * np.abs(np.sinc(f[:, None] * near))) / np.sqrt(1 + near / noise)
        assert best.objective == pytest.approx(around.max(), rel=1e-9)


def test_bounds_may_be_any_whole_numbers() -> None:
    front, same = (exposure_front(100.0, 200.0, bounds=bounds, points=9) for bounds in ((0, 2**70), (0.0, 2.0**70)))
    assert np.array_equal(front.exposure, same.exposure)
