"""Exposures without bands: modulation against the exposure integral, the choice against searches on grids, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from ocisac_fast import Camera, SquareWave, Tone, integrate_exposure, reference
from ocisac_fast.exposure import (
    FlickeringLight,
    best_exposure,
    exposure_modulation,
    flicker_free_exposure,
    flicker_front,
    mains_lights,
)

lights = st.builds(
    FlickeringLight,
    frequency=st.floats(40.0, 2000.0),
    uncertainty=st.floats(0.0, 5.0),
    duty=st.one_of(st.none(), st.floats(0.02, 0.98)),
    depth=st.floats(0.2, 1.0),
)
exposures = st.floats(1e-5, 0.1)


class TestModulation:
    @settings(deadline=None, max_examples=2 * settings.default.max_examples // 5)
    @given(lights, exposures)
    def test_is_that_of_the_exposure_integral(self, light: FlickeringLight, exposure: float) -> None:
        known = FlickeringLight(light.frequency, uncertainty=0.0, duty=light.duty, depth=light.depth)
        expected = reference.exposure_modulation(known, exposure)
        assert exposure_modulation(known, exposure) == pytest.approx(expected, abs=1e-10)
        assert exposure_modulation(light, exposure) >= reference.exposure_modulation(light, exposure) - 1e-10

    @settings(deadline=None, max_examples=settings.default.max_examples // 2)
    @given(lights, exposures)
    def test_the_worst_frequency_is_reached(self, light: FlickeringLight, exposure: float) -> None:
        """A sampled maximum is short of the true one by no more than a step times the steepest slope."""
        tried = light.frequency + np.linspace(-1, 1, 4001) * light.uncertainty
        each = exposure_modulation(
            FlickeringLight(1.0, uncertainty=0.0, duty=light.duty, depth=light.depth), tried * exposure
        )
        slope = 4.0 if light.duty is None else 4.0 / (light.duty * (1.0 - light.duty))
        step = light.uncertainty * exposure / 2000
        assert -1e-12 <= float(exposure_modulation(light, exposure)) - each.max() <= slope * step + 1e-12

    @pytest.mark.parametrize("light", [FlickeringLight(100.0), FlickeringLight(100.0, duty=0.3)])
    def test_bands_of_a_recording_are_as_told(self, light: FlickeringLight) -> None:
        wave = Tone(100.0) if light.duty is None else SquareWave(100.0, duty=light.duty)
        for exposure in (0.003, 0.0098, 0.0203):
            rows = integrate_exposure(wave, Camera(1e-6, exposure), 20_000)
            seen = (rows.max() - rows.min()) / (rows.max() + rows.min())
            assert exposure_modulation(light, exposure) == pytest.approx(seen, abs=1e-4)

    def test_no_exposure_shows_the_light_itself(self) -> None:
        for duty in (None, 0.1, 0.9):
            assert exposure_modulation(FlickeringLight(100.0, duty=duty, depth=0.7), 0.0) == pytest.approx(0.7)

    @settings(deadline=None, max_examples=settings.default.max_examples // 2)
    @given(st.floats(0.02, 0.97), st.floats(0.001, 0.02), exposures)
    def test_falls_with_the_duty(self, duty: float, more: float, exposure: float) -> None:
        short, long = (exposure_modulation(FlickeringLight(90.0, duty=d), exposure) for d in (duty, duty + more))
        assert long <= short + 1e-12

    def test_mains_bound_rectified_sines_near_the_nulls(self) -> None:
        orders = np.arange(1, 400)[:, None]
        phases = np.linspace(0, 2 * np.pi, 400)
        for exposure in (0.01, 0.02, 0.05):
            cycles = 101.0 * exposure
            waves = 2 / (4 * orders**2 - 1) * np.sinc(orders * cycles) * np.cos(orders * phases)
            light = 1 - waves.sum(axis=0)
            bound = exposure_modulation(mains_lights([50.0])[0], exposure)
            assert (light.max() - light.min()) / (light.max() + light.min()) <= bound


class TestChoice:
    def test_mains_of_two_continents(self) -> None:
        found = flicker_free_exposure([FlickeringLight(100.0), FlickeringLight(120.0)], 0.02)
        assert f"{found.exposure * 1e3:.1f}" == "49.0"
        assert found.holds
        assert found.modulation == pytest.approx(0.02, abs=1e-12)
        assert found.modulation <= 0.02

    @settings(deadline=None, max_examples=settings.default.max_examples // 4)
    @given(st.lists(lights, min_size=1, max_size=3), st.floats(0.01, 0.5), st.floats(1e-3, 0.03), st.booleans())
    def test_no_better_one_on_a_fine_grid(
        self, some: list[FlickeringLight], below: float, longest: float, nearest: bool
    ) -> None:
        """The shortest exposure that holds, or the nearest to one; else the least modulation."""
        bounds, target = (longest / 50, longest), longest / 3 if nearest else 0.0
        grid = np.linspace(*bounds, 20_001)
        left = np.max([exposure_modulation(x, grid) for x in some], axis=0)
        try:
            found = flicker_free_exposure(some, below, near=target if nearest else None, bounds=bounds)
        except ValueError:
            assert np.all(left <= below)
            return
        assert bounds[0] <= found.exposure <= bounds[1]
        assert found.modulation == max(float(exposure_modulation(x, found.exposure)) for x in some)
        assert found.holds == (found.modulation <= below)
        if found.holds:
            assert np.all(left[np.abs(grid - target) < abs(found.exposure - target) - 1e-9 * longest] > below)
        else:
            assert left.min() >= found.modulation * (1 - 1e-9)

    @settings(deadline=None, max_examples=3 * settings.default.max_examples // 20)
    @given(st.lists(lights, min_size=1, max_size=2), st.floats(0.01, 0.3), st.floats(5e-6, 1e-3), st.floats(1e-3, 0.05))
    def test_steps_are_all_tried(self, some: list[FlickeringLight], below: float, step: float, near: float) -> None:
        found = flicker_free_exposure(some, below, step=step, near=near)
        grid = step * np.arange(1, math.floor(0.1 / step) + 1)
        left = np.max([exposure_modulation(x, grid) for x in some], axis=0)
        assert found.holds == bool(np.any(left <= below))
        assert found.exposure / step == pytest.approx(round(found.exposure / step), abs=1e-9)
        if found.holds:
            assert abs(found.exposure - near) == pytest.approx(np.abs(grid[left <= below] - near).min(), abs=1e-15)
        else:
            assert found.modulation == left.min()


class TestBothAtOnce:
    @settings(deadline=None, max_examples=3 * settings.default.max_examples // 20)
    @given(st.lists(lights, min_size=1, max_size=2), st.floats(5.0, 900.0), st.floats(0.05, 0.9), st.floats(0.05, 0.5))
    def test_the_gain_is_kept(self, some: list[FlickeringLight], data: float, gain: float, below: float) -> None:
        assume(all(abs(data - light.frequency) > light.uncertainty for light in some))
        found = flicker_free_exposure(some, below, f_comm=data, min_gain=gain, bounds=(1e-5, 0.05))
        grid = np.linspace(1e-5, 0.05, 20_001)
        keeps = np.abs(np.sinc(data * grid)) >= gain
        left = np.max([exposure_modulation(x, grid) for x in some], axis=0)
        good = grid[keeps & (left <= below)]
        assert found.gain == pytest.approx(abs(np.sinc(data * found.exposure)), abs=1e-12)
        if found.holds:
            assert found.gain >= gain - 1e-12
            assert good.size == 0 or found.exposure <= good[0] * (1 + 1e-12)
        else:
            assert good.size == 0
            assert not keeps.any() or found.modulation <= left[keeps].min() + 1e-9

    @settings(deadline=None, max_examples=3 * settings.default.max_examples // 20)
    @given(st.lists(lights, min_size=1, max_size=2), st.floats(50.0, 900.0), st.floats(20.0, 400.0))
    def test_eq_18_is_largest_among_exposures_without_bands(
        self, some: list[FlickeringLight], comm: float, sense: float
    ) -> None:
        assume(all(abs(comm - light.frequency) > light.uncertainty for light in some))
        found = flicker_free_exposure(some, 0.1, f_comm=comm, f_sense=sense, bounds=(1e-5, 0.05))
        grid = np.linspace(1e-5, 0.05, 20_001)
        good = grid[np.max([exposure_modulation(x, grid) for x in some], axis=0) <= 0.1]
        values = sum(np.abs(np.sin(np.pi * f * good)) / (np.pi * f) for f in (comm, sense))
        if found.holds:
            assert good.size == 0 or found.objective >= np.max(values) * (1 - 1e-9)
            free = best_exposure(comm, sense, bounds=(1e-5, 0.05))
            assert found.objective <= float(free.objective) * (1 + 1e-12)
        else:
            assert good.size == 0

    def test_a_light_to_avoid_next_to_the_data_light(self) -> None:
        found = flicker_free_exposure([FlickeringLight(100.0)], 0.02, f_comm=100.0 + 1e-9, min_gain=0.5)
        assert not found.holds
        assert found.modulation == pytest.approx(0.5)

    def test_front(self) -> None:
        some = [FlickeringLight(100.0), FlickeringLight(120.0, duty=0.2)]
        front = flicker_front(35.0, some, bounds=(0.0, 0.06), points=2001)
        for k in np.flatnonzero(~front.efficient):
            better = (front.gain >= front.gain[k]) & (front.modulation <= front.modulation[k])
            assert np.any(better & front.efficient)
        best = flicker_free_exposure(some, 0.02, f_comm=35.0, min_gain=0.1, bounds=(1e-6, 0.06))
        better = (
            (front.gain > best.gain * (1 + 1e-9))
            & (front.modulation < 0.02 * (1 - 1e-6))
            & (front.exposure < best.exposure * (1 - 1e-9))
        )
        assert not np.any(better)

    def test_times_in_milliseconds_are_refused_before_they_fill_the_memory(self) -> None:
        with pytest.raises(ValueError, match=r"bounds: got 6.6e\+08 cycles of 20000 Hz, allowed: at most a million"):
            flicker_front(500.0, [FlickeringLight(20000.0)], bounds=(1000.0, 33000.0))
