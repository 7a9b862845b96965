"""Links over distance: as good as the known-everything detector where packets fit; what others published."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from studies.distance import __main__ as command, published
from studies.distance.links import Link, measure_link
from studies.distance.published import MATUS, MATUS_CHIP, MATUS_EXPOSURE, ErrorCount
from studies.distance.sweeps import Sweep


@pytest.mark.parametrize("link", [Link(10.0), Link(15.0, closing=5.0), Link(ambient=0.5), Link(lamps=2)])
def test_a_clear_link_is_read_as_well_as_with_everything_known(link: Link) -> None:
    counts = measure_link(link, 1)
    assert counts.received == counts.bound == counts.packets == link.lamps
    assert counts.wrong_payloads == 0
    assert counts.bound_errors == 0
    assert counts.read > 0.9 * counts.chips
    assert counts.read_errors <= 1e-3 * counts.read


def test_a_lamp_too_far_away_gives_no_payload_to_anyone() -> None:
    counts = measure_link(Link(50.0), 1)
    assert (counts.received, counts.bound, counts.wrong_payloads) == (0, 0, 0)
    assert counts.chips > 0


def test_a_square_wave_correlates_as_its_triangle() -> None:
    """An exposure of one chip makes 0101… a triangle: r = (1/2) / sqrt(1/3)."""
    r = published.correlation_after_exposure((0, 1), 1e-3, 1e-3)
    assert r == pytest.approx(math.sqrt(3) / 2, abs=1e-3)
    assert published.correlation_after_exposure((0, 1), 1e-3, 1e-9) == pytest.approx(1.0, abs=1e-6)


def test_published_correlations_lie_between_those_of_a_sequence_and_of_random_chips() -> None:
    random = tuple(int(chip) for chip in np.random.default_rng(1).integers(0, 2, 2000))
    for share, printed in MATUS.items():
        values = [
            published.correlation_after_exposure(chips, MATUS_CHIP, MATUS_EXPOSURE, share)
            for chips in ((0, 0, 0, 0, 1), random)
        ]
        assert min(values) - 0.01 < printed < max(values)


def test_error_counts_are_bounded() -> None:
    assert ErrorCount(0, 1000).bound == pytest.approx(-math.log(0.05) / 1000, rel=1e-9)
    counted, predicted = published.long_exposure_errors(7.0, 0.2, 4000)
    assert 0 < counted.wrong / counted.chips < counted.bound
    assert predicted > 1e-4
    assert published.long_exposure_errors(7.0, 0.02, 4000)[0].wrong == 0


def test_all_lights_are_found_and_none_is_false() -> None:
    frequencies = published.RAJAGOPAL
    assert published.simultaneous_lights(frequencies, seed=5) == (len(frequencies), 0)


def test_a_symbol_a_row_is_detected_better_than_by_three_taps() -> None:
    result = published.one_row_symbol_errors(0.15)
    q = 0.5 * math.erfc(0.5 / 0.15 / math.sqrt(2.0))
    assert result.detected[0] == pytest.approx(q, abs=4 * math.sqrt(q / 20_000))  # matched filter of one row
    assert np.all(result.detected <= result.three_taps + 4 * np.sqrt(result.three_taps / 20_000))
    assert result.three_taps[-1] > 2 * result.detected[-1]


def test_the_command_draws_and_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sweep = Sweep("distance", "distance / m", (30.0, 40.0), (Link(30.0), Link(40.0)))
    monkeypatch.setattr(command, "SWEEPS", [sweep])
    monkeypatch.setattr(command, "comparison", dict)
    picture, text = tmp_path / "distance.png", tmp_path / "page.md"
    text.write_text("<!-- distance: distance -->\n<!-- distance: end -->\n", encoding="utf-8")
    command.main(["--recordings", "1", "-o", str(picture), "--text", str(text)])
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert text.read_text(encoding="utf-8").count("\n| ") == 3
