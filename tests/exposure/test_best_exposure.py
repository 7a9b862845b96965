"""Exposure choice: the published figures, the exact maximum against brute force, and refusals."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import ocisac_fast as of
from ocisac_fast import reference
from ocisac_fast.exposure import BestExposure

F_MIN = 100.0
F_MAX = F_MIN / (np.arange(1, 101) / 100)  # 1/eps = 0.01 ... 1.00

frequencies = st.floats(20.0, 5000.0)
weights = st.floats(0.05, 20.0)


def deviation(objective: np.ndarray, best: np.ndarray) -> tuple[float, float]:
    """Mean and largest normalised deviation in percent."""
    loss = 100 * (1 - objective / best)
    return float(loss.mean()), float(loss.max())


@pytest.fixture(scope="module")
def exact() -> BestExposure:
    return of.best_exposure(F_MAX, F_MIN)


class TestPublishedFigures:
    def test_closed_form_and_rounding_instead_of_floor(self, exact: BestExposure) -> None:
        closed, rounded = (of.best_exposure(F_MAX, F_MIN, method=method) for method in ("closed-form", "rounded"))
        figures = [f"{value:.2f}" for one in (closed, rounded) for value in deviation(one.objective, exact.objective)]
        assert figures == ["5.71", "36.62", "1.67", "7.08"]
        assert np.argmin(closed.objective / exact.objective) == 33  # at 1/eps = 0.34

    def test_search_is_the_papers_grid(self, exact: BestExposure) -> None:
        search = of.best_exposure(F_MAX, F_MIN, method="search", points=400_001)
        assert np.all(exact.objective >= np.asarray(search.objective) * (1 - 1e-14))
        assert deviation(search.objective, exact.objective)[1] < 1e-6
        steps = np.asarray(search.exposure) * F_MIN * 400_000
        np.testing.assert_allclose(steps, np.rint(steps), rtol=0, atol=1e-6)

    def test_signed_sines_give_other_figures(self) -> None:
        """Why the objective has magnitudes: with eq. 18 as printed the published figures do not come out."""

        def signed(f: np.ndarray, exposure: np.ndarray) -> np.ndarray:
            return np.asarray((np.sin(np.pi * np.multiply.outer(exposure, f)) / (np.pi * f)).sum(axis=-1))

        closed = np.atleast_1d(of.best_exposure(F_MAX, F_MIN, method="closed-form").exposure)
        grid = np.linspace(0, 1 / F_MIN, 10_001)[1:]
        losses = []
        for f, exposure in zip(F_MAX, closed, strict=True):
            tones = np.array([f, F_MIN])
            losses.append(100 * (1 - signed(tones, np.array([exposure]))[0] / signed(tones, grid).max()))
        assert (f"{np.mean(losses):.2f}", f"{np.max(losses):.2f}") == ("9.17", "48.17")


class TestExact:
    @settings(deadline=None, max_examples=2 * settings.default.max_examples // 5)
    @given(st.lists(frequencies, min_size=2, max_size=4), st.data())
    def test_bounds_and_more_tones_against_brute_force(self, tones: list[float], data: st.DataObject) -> None:
        weight = data.draw(st.lists(weights, min_size=len(tones), max_size=len(tones)))
        low = data.draw(st.floats(0, 0.01))
        bounds = (low, low + data.draw(st.floats(1e-5, 0.02)))
        more = tones[2:]
        best = of.best_exposure(tones[0], tones[1], weights=weight, bounds=bounds, more=more)
        brute = reference.best_exposure(tones[0], tones[1], weights=weight, bounds=bounds, more=more)
        assert bounds[0] <= best.exposure <= bounds[1]
        assert best.objective == pytest.approx(brute.objective, rel=1e-10)

    @settings(deadline=None, max_examples=2 * settings.default.max_examples // 5)
    @given(frequencies, frequencies, st.floats(1e-6, 3e-4), st.floats(0, 0.01), st.floats(4e-4, 0.02))
    def test_steps_against_all_multiples(self, f_1: float, f_2: float, step: float, low: float, width: float) -> None:
        bounds = (low, low + width)
        best = of.best_exposure(f_1, f_2, bounds=bounds, step=step)
        brute = reference.best_exposure(f_1, f_2, bounds=bounds, step=step)
        search = of.best_exposure(f_1, f_2, method="search", bounds=bounds, step=step)
        assert best.objective == pytest.approx(brute.objective, rel=1e-12)
        assert search.objective == pytest.approx(brute.objective, rel=1e-12)
        assert best.exposure / step == pytest.approx(round(best.exposure / step), abs=1e-9)

    def test_a_longer_domain_is_better_for_70_of_the_100_ratios(self) -> None:
        paper = of.best_exposure(F_MAX, F_MIN)
        longer = of.best_exposure(F_MAX, F_MIN, bounds=(0, 20 / F_MIN))
        assert np.count_nonzero(np.asarray(longer.objective) > np.asarray(paper.objective) * (1 + 1e-9)) == 70

    def test_zero_weights(self) -> None:
        assert of.best_exposure(350.0, 100.0, weights=(0, 1)).exposure == pytest.approx(1 / 200, rel=1e-15)
        assert of.best_exposure(350.0, 100.0, weights=(1, 0)).exposure == pytest.approx(1 / 700, rel=1e-15)
        assert of.best_exposure(350.0, 100.0, weights=(1, 0), bounds=(0.002, 0.003)).exposure == 0.002

    def test_equal_lobes_give_the_shorter_exposure(self) -> None:
        best = of.best_exposure(200.0, 100.0)
        assert best.exposure < 1 / 200
        assert of.exposure_objective(0.01 - best.exposure, 200.0, 100.0) == pytest.approx(best.objective, rel=1e-14)

    def test_equal_frequencies(self) -> None:
        best = of.best_exposure(100.0, 100.0)
        assert best.exposure == pytest.approx(1 / 200)
        assert best.objective == pytest.approx(2 / (math.pi * 100))

    @pytest.mark.parametrize("ratio", [1e3, 1e9, 1e15, 1e18, 1e250])
    def test_extreme_ratios(self, ratio: float) -> None:
        best = of.best_exposure(1e-20 * ratio, 1e-20)
        assert best.exposure == pytest.approx(0.5e20, rel=1e-3)
        assert best.objective >= 1e20 / math.pi * (1 - 1e-12)

    def test_arrays_and_scalars(self) -> None:
        f_comm, f_sense = np.array([[200.0], [500.0], [700.0]]), np.array([175.0, 350.0])
        best = of.best_exposure(f_comm, f_sense)
        assert np.shape(best.exposure) == np.shape(best.objective) == (3, 2)
        one = of.best_exposure(500.0, 350.0)
        assert isinstance(one.exposure, float)
        assert one.exposure == np.asarray(best.exposure)[1, 1]
        assert np.shape(of.best_exposure(np.empty(0), 100.0).exposure) == (0,)
        more = of.best_exposure(f_comm, f_sense, weights=(1, 1, 2), more=[np.array([150.0, 90.0])])
        assert np.shape(more.exposure) == (3, 2)


class TestObjective:
    @settings(deadline=None, max_examples=settings.default.max_examples // 2)
    @given(st.floats(0, 10), frequencies, frequencies, st.floats(0, 5), weights)
    def test_agrees_with_rational_arithmetic(self, T: float, f_1: float, f_2: float, w_1: float, w_2: float) -> None:
        expected = reference.exposure_objective(T, f_1, f_2, (w_1, w_2))
        assert of.exposure_objective(T, f_1, f_2, weights=(w_1, w_2)) == pytest.approx(expected, rel=1e-14, abs=1e-300)

    def test_next_to_a_zero(self) -> None:
        f, exposure = 4950.0, np.nextafter(1000 / 4950.0, 1)
        cycles = Fraction(f) * Fraction(float(exposure)) - 1000
        value = of.exposure_objective(exposure, f, f, weights=(1, 0))
        assert value == pytest.approx(abs(math.pi * float(cycles)) / (math.pi * f), rel=1e-12)

    def test_broadcasts(self) -> None:
        exposures = np.linspace(0, 0.01, 7)
        values = of.exposure_objective(
            exposures[:, None], np.array([200.0, 300.0]), 100.0, weights=(1, 2, 3), more=[50.0]
        )
        expected = reference.exposure_objective(exposures[:, None], np.array([200.0, 300.0]), 100.0, (1, 2, 3), [50.0])
        assert np.shape(values) == (7, 2)
        assert np.allclose(values, expected, rtol=1e-13, atol=0)
