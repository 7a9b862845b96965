"""Random scenes: cleaning never makes a frame worse than it was decoded."""

from __future__ import annotations

import cleaning_scenes
import pytest


@pytest.mark.parametrize("seed", [1, 22])
def test_scenes_without_a_lamp_stay_as_they_are(seed: int) -> None:
    """In scene 1 the edges of boxes and lines of text fit a chip clock, which the receiver flags as too few edges."""
    found = cleaning_scenes.measured(seed, 720, plain=True)
    assert found["periods"] == []
    assert found["unchanged"] == cleaning_scenes.FRAMES


@pytest.mark.parametrize("seed", [6, 10, 11])
def test_bands_of_a_lamp_become_fainter_in_every_frame(seed: int) -> None:
    found = cleaning_scenes.measured(seed, 720, plain=True)
    assert not {"least_gain_db", "cast", "burnt", "swing"} & set(found["broken"])
    assert found["gain_db"] > 5
