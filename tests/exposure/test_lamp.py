"""The lamp's side: frequencies, duties and chip rates against the modulation itself, and against real code words."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from ocisac_fast import Camera, Chips, integrate_exposure, reference
from ocisac_fast.exposure import (
    DIGITAL_SUM_SPANS,
    FlickeringLight,
    exposure_modulation,
    flicker_free_chip_rate,
    flicker_free_frequencies,
    flicker_indices,
    smallest_flicker_free_duty,
    unmissed_frequency,
)
from ocisac_fast.packets.transmission import encode_line_code

ROUNDING = 1e-12
shutters = st.lists(st.floats(2e-4, 0.03), min_size=1, max_size=3)
duties = st.one_of(st.none(), st.floats(0.03, 0.97))


@settings(deadline=None, max_examples=3 * settings.default.max_examples // 10)
@given(shutters, duties, st.floats(0.01, 0.5), st.floats(0.0, 0.02))
@example([0.0234375], 0.05227697141707196, 1 / 3, 0.0)
@example([0.015625], 0.05227697141707196, 1 / 3, 0.0)
def test_frequencies_are_those_and_all_those(
    exposures: list[float], duty: float | None, below: float, spread: float
) -> None:
    found = flicker_free_frequencies(exposures, below, (50.0, 2000.0), duty=duty, exposure_spread=spread)
    grid = np.linspace(50.0, 2000.0, 20_001)
    lights = [FlickeringLight(t, uncertainty=t * spread, duty=duty) for t in exposures]
    left = np.max([exposure_modulation(light, grid) for light in lights], axis=0)
    inside = np.zeros(grid.size, bool)
    for low, high in found.intervals:
        inside |= (grid >= low * (1 - 1e-12)) & (grid <= high * (1 + 1e-12))
    if found.holds:
        assert found.modulation <= below * (1 + ROUNDING)
        assert np.array_equal(inside, left <= below) or np.abs(left[inside != (left <= below)] - below).max() < 1e-9
    else:
        assert left.min() > below
        assert found.modulation <= left.min() * (1 + 1e-9)
    beyond = found.always_from * np.linspace(1.0 + 1e-9, 5.0, 5001)
    for light in lights:
        assert np.all(exposure_modulation(light, beyond) <= below * (1 + ROUNDING))


@pytest.mark.parametrize("duty", [None, 0.1, 0.7])
def test_frequencies_hold_by_the_exposure_integral(duty: float | None) -> None:
    exposures = (1 / 60, 1 / 100)
    found = flicker_free_frequencies(exposures, 0.05, (50.0, 1500.0), duty=duty)
    assert found.holds
    for low, high in found.intervals[:6]:
        for frequency, inside in ((low * 1.00001, True), (high * 0.99999, True), (low * 0.9999, False)):
            light = FlickeringLight(float(frequency), duty=duty)
            assert bool(np.max(reference.exposure_modulation(light, exposures)) <= 0.05) == inside


@settings(deadline=None, max_examples=3 * settings.default.max_examples // 10)
@given(shutters, st.floats(60.0, 2000.0), st.floats(0.01, 0.5))
def test_least_duty(exposures: list[float], frequency: float, below: float) -> None:
    duty = smallest_flicker_free_duty(frequency, exposures, below)

    def left(d: float) -> float:
        return float(np.max(exposure_modulation(FlickeringLight(frequency, duty=d), exposures)))

    if duty > 1e-6:
        assert left(duty * (1 - 1e-9)) > below * (1 - 1e-9)
    if 0.0 < duty < 1.0:
        assert left(duty) <= below
        assert left(0.5 * (1 + duty)) <= below


@settings(deadline=None, max_examples=settings.default.max_examples // 5)
@given(shutters, st.floats(0.03, 0.97))
def test_pulses_are_missed_below_the_frequency_alone(exposures: list[float], duty: float) -> None:
    frequency = unmissed_frequency(exposures, duty)
    for factor in (1.0 + 1e-9, 1.7):
        assert np.all(flicker_indices(FlickeringLight(factor * frequency, duty=duty), exposures).missed <= 1e-8)
    slower = flicker_indices(FlickeringLight(0.9 * frequency, duty=duty), exposures)
    assert slower.missed.max() == pytest.approx(0.1 * (1 - duty))


@pytest.mark.parametrize("code", sorted(DIGITAL_SUM_SPANS))
def test_chip_rates_hold_for_the_line_codes(code: str) -> None:
    bits = np.random.default_rng(1).integers(0, 2, 80_000)
    chips = np.asarray(encode_line_code(bits, code), dtype=np.float64)
    total = np.concatenate([[0.0], np.cumsum(2 * chips - 1)])
    assert total.max() - total.min() == DIGITAL_SUM_SPANS[code]
    exposure = 1e-3
    rate = flicker_free_chip_rate([exposure, 3e-3], 0.05, digital_sum_span=DIGITAL_SUM_SPANS[code])
    rows = integrate_exposure(Chips(chips, rate), Camera(0.3 / rate, exposure), 100_000, start=exposure)
    seen = (rows.max() - rows.min()) / (rows.max() + rows.min())
    assert 0.03 < seen <= 0.05 * (1 + 1e-9)


def test_chip_rate_of_manchester_is_reached() -> None:
    """x even: 01 10 at one end and the reverse at the other make the most of the bound."""
    rate = flicker_free_chip_rate([1e-3], 0.05, digital_sum_span=2)
    bright = [0, 1] + [1, 0] * 20 + [1, 0]
    rows = integrate_exposure(Chips(bright, rate), Camera(1 / rate, 1e-3), 2, start=41 / rate)
    assert rate == pytest.approx(40_000)
    assert rows.max() == pytest.approx(0.5 + 2 / (2 * 40))
