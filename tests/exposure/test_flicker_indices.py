"""The flicker indices of IEEE P2020 in closed form against a million random phases of the exposure integral."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from ocisac_fast import reference
from ocisac_fast.exposure import FlickeringLight, exposure_modulation, flicker_indices


@pytest.mark.parametrize(
    "duty", [None, 0.3, 0.9, *(pytest.param(duty, marks=pytest.mark.nightly) for duty in (0.05, 0.5))]
)
@pytest.mark.parametrize("background", [0.0, 0.3])
def test_a_million_random_phases(duty: float | None, background: float) -> None:
    light = FlickeringLight(90.0, duty=duty, depth=0.8 if duty == 0.3 else 1.0)
    exposures = np.array([3e-4, 4.3e-3, 10e-3, 26.7e-3])
    settings = {"background": background, "contrast": 0.37, "tolerance": 0.13}
    found = flicker_indices(light, exposures, **settings)
    drawn = reference.flicker_indices(light, exposures, **settings)
    assert np.allclose(found.modulation_index, drawn.modulation_index, atol=2e-5)
    for name in ("detection_index", "mitigation_probability", "missed"):
        share = getattr(found, name)
        deviation = np.sqrt(np.maximum(share * (1 - share), 0) / 1e6)
        assert np.all(np.abs(share - getattr(drawn, name)) <= 5 * deviation + 1e-5), name


@settings(deadline=None, max_examples=settings.default.max_examples // 1)
@given(st.floats(1.0, 3000.0), st.one_of(st.none(), st.floats(0.01, 0.99)), st.floats(1e-5, 0.1), st.floats(0.0, 2.0))
def test_probabilities(frequency: float, duty: float | None, exposure: float, background: float) -> None:
    light = FlickeringLight(frequency, duty=duty)
    found = flicker_indices(light, exposure, background=background)
    for value in (found.modulation_index, found.detection_index, found.mitigation_probability, found.missed):
        assert -1e-12 <= value <= 1 + 1e-12
    assert flicker_indices(light, exposure).modulation_index == pytest.approx(
        float(exposure_modulation(light, exposure)), abs=1e-9
    )
    if duty is not None:
        assert found.missed == pytest.approx(max(0.0, 1.0 - frequency * exposure - duty), abs=1e-9)
    wider = flicker_indices(light, exposure, background=background, tolerance=0.3)
    assert wider.mitigation_probability >= found.mitigation_probability - 1e-12


def test_whole_periods_mitigate_everything() -> None:
    found = flicker_indices(FlickeringLight(125.0, duty=0.3), [8e-3, 16e-3], tolerance=1e-3)
    assert np.allclose(found.modulation_index, 0.0)
    assert np.allclose(found.mitigation_probability, 1.0)
    assert np.allclose(found.detection_index, 1.0)
