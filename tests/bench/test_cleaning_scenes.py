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
    rows = list(cleaning_scenes.table(json.dumps(one) for one in (long, none, {"scenes": 2, "broken": {}})))[2:]
    assert "| bands: longer, less than a cycle | 1 | -0.2 | 3.0 | 2.00 | 2.0 | 50% | behind_db 1 |" in rows
    assert "| all | 2 | -0.2 | 3.0 | 2.00 | 2.0 | 50% | behind_db 1 |" in rows
    assert len(rows) == 8
