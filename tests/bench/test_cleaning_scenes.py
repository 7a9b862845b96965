"""Random scenes: cleaning never makes a frame worse than it was decoded."""

from __future__ import annotations

import json

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


def test_the_table_has_a_row_for_each_kind_of_scene() -> None:
    facts = {"rows": 480, "is_even": True, "curve": "hlg", "coded": "libx264 8 bit crf 20", "motion": "pan"}
    values = {"least_gain_db": -0.2, "gain_db": 3.0, "behind_db": 2.0, "unchanged": 3}
    long = {"seed": 1, "periods": [600], **facts, **values, "broken": ["behind_db"]}
    none = {"seed": 2, "periods": [], **facts, **values, "broken": []}
    still = {**long, "seed": 3, "oracle_db": -9.5}
    rows = list(cleaning_scenes.table(json.dumps(one) for one in (long, none, still, {"scenes": 3, "broken": {}})))[2:]
    assert "| bands: longer, less than a cycle | 1 | -0.2 | 3.0 | 2.00 | 2.0 | 50% | behind_db 1 |" in rows
    assert "| all | 2 | -0.2 | 3.0 | 2.00 | 2.0 | 50% | behind_db 1 |" in rows
    assert "| left out: not to be told apart | 1 | -0.2 | 3.0 | 2.00 | 2.0 | 50% | behind_db 1 |" in rows
    assert len(rows) == 9


@pytest.mark.parametrize(("seed", "least"), [(6152, -20.0), (6106, 5.0)])
def test_the_oracle_tells_two_lamps_that_move_and_not_one_that_stands(seed: int, least: float) -> None:
    _, camera, _, frames = cleaning_scenes.film(seed, 2160, "srgb")
    gain = cleaning_scenes.known_gain(frames, camera)
    assert least < gain < least + 15
