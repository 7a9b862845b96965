"""Predicted error rates: what bench/calibration.py counts."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import calibration
import field_pictures
import numpy as np
import pytest
from calibration import DECADES, Counts
from draws import EFFECTS, Draw

DOCUMENT = Path(__file__).parents[2] / "docs" / "measured" / "field.md"


def test_a_clean_lamp_has_no_wrong_chip_and_is_sure(monkeypatch):
    monkeypatch.setattr(calibration, "FRAMES", 3)
    counts = calibration.counted(field_pictures.CLEAN)
    assert (counts.frames, counts.read, counts.draws) == (3, 3, 1)
    assert counts.chips.sum() > 3 * 180
    assert (counts.wrong.sum(), counts.silent, counts.wrong_payloads) == (0, 0, 0)
    assert counts.chips[-1] == counts.chips.sum()


def test_chips_of_another_light_are_counted_as_wrong(monkeypatch):
    """The truth is what is sent, not what is read: frames of a lamp that sends something else are half wrong."""
    monkeypatch.setattr(calibration, "FRAMES", 3)
    frames = Draw.frames
    monkeypatch.setattr(Draw, "frames", lambda draw, chips, count: frames(draw, np.roll(chips, 1501), count))
    counts = calibration.counted(field_pictures.CLEAN)
    assert 0.3 < counts.wrong.sum() / counts.chips.sum() < 0.7
    assert counts.silent == 3


@pytest.mark.parametrize(("seed", "frames"), [(68040, 1), (68045, 1), (72050, 13)])
def test_a_pause_of_the_read_out_is_no_silent_frame_where_edges_may_lie_off_the_clock(monkeypatch, seed, frames):
    """Jitter of the sender, two exposures, hot rows beside it: edges off the clock take up the pause."""
    monkeypatch.setattr(calibration, "FRAMES", frames)
    assert calibration.counted(Draw.of_devices(seed)).silent == 0


@pytest.mark.parametrize(
    ("wrong", "expected", "good"), [(30, 20.0, True), (50, 20.0, False), (11, 23.0, False), (3, 4.0, None)]
)
def test_a_decade_is_calibrated_within_a_factor_of_two(wrong, expected, good):
    counts = Counts()
    counts.chips[1], counts.wrong[1], counts.expected[1] = 1000, wrong, expected
    assert counts.calibrated(1) is good
    assert counts.calibrated(2) is None


def test_draws_are_repeatable_and_have_all_impairments():
    draws = [Draw.of(seed) for seed in range(60)]
    assert draws == [Draw.of(seed) for seed in range(60)]
    for name in {item.name for item in dataclasses.fields(Draw)} - {"told_chip_rate", "told_exposure", "effects"}:
        assert len({getattr(draw, name) for draw in draws}) > (1 if name == "mains" else 10), name
    assert {draw.told_exposure for draw in draws} > {None, 1.0}


def test_the_document_has_both_tables():
    text = DOCUMENT.read_text(encoding="utf-8")
    shown = {
        kind: re.search(rf"<!-- {kind}: table -->\n(.*?)<!-- {kind}: end -->", text, re.DOTALL)
        for kind in ("field", "calibration")
    }
    assert all(shown.values())
    titles = [line.split(" | ")[0].strip("| ") for line in shown["field"][1].splitlines()[2:]]
    assert titles == [title for title, _ in field_pictures.CASES]
    assert set(field_pictures.LEVELS) == set(EFFECTS)
    names = [line.split(" | ")[0].strip("| ") for line in shown["calibration"][1].splitlines()[2 : 2 + DECADES]]
    assert names == [calibration.name_of(k) for k in range(DECADES)]


def test_draws_of_devices_are_repeatable_and_have_all_effects():
    draws = [Draw.of_devices(seed) for seed in range(80)]
    assert draws == [Draw.of_devices(seed) for seed in range(80)]
    assert {effect for draw in draws for effect in draw.effects} == set(EFFECTS)


@pytest.mark.parametrize("effects", [{}, {"inverted": 1.0}, {"row-pause": 20.0}, {"late-frames": 0.5}])
def test_a_clean_device_has_no_wrong_chip(monkeypatch, effects):
    """The truth follows the rows' times, the frames' starts and the lamp's polarity."""
    monkeypatch.setattr(calibration, "FRAMES", 3)
    draw = Draw(8e3, 8e3, 622e-6, 120.0, 1.0, 26.0, 1.3, effects, 0)
    counts = calibration.counted(draw)
    assert counts.chips.sum() > 3 * 180
    assert counts.wrong.sum() == 0
