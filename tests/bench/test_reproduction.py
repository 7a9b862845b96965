"""The paper's testbed made again: gains that are those of theory, deviations that are those printed."""

from __future__ import annotations

import pathlib

import numpy as np
import pytest
from scipy.stats import chi2

from ocisac_fast import SquareWave, demo, integrate_exposure
from studies.reproduction import __main__ as reproduction, choices, gains, testbed
from studies.reproduction.figures import FIGURES
from studies.reproduction.testbed import Setting, settings

DOCUMENT = pathlib.Path(__file__).resolve().parents[2] / "docs" / "measured" / "paper.md"


def test_ring_takes_whole_periods_and_says_its_true_grating():
    assert [demo.periods_on_ring(grating) for grating in demo.GRATINGS] == [47, 94, 236]
    for grating in demo.GRATINGS:
        setting = Setting("sensing", grating, 1e-3)
        assert setting.frequency == pytest.approx(testbed.true_grating(grating) * testbed.speed(), rel=1e-12)
    assert testbed.speed() == pytest.approx(1.751, abs=5e-4)


def test_recording_is_the_light_through_the_exposure():
    setting = Setting("communication", 200.0, 2404e-6)
    recorded = testbed.record(setting, 6, seed=1)
    assert recorded.shape == (6, 720, 1)
    assert recorded.dtype == np.uint8
    np.testing.assert_array_equal(recorded, testbed.record(setting, 6, seed=1))
    assert np.any(recorded != testbed.record(setting, 6, seed=2))
    turn = np.random.default_rng([1, settings().index(setting)]).uniform()
    light = integrate_exposure(SquareWave(200.0, phase=2 * np.pi * turn), setting.camera, 720, frames=6)
    error = recorded[..., 0] - (demo.DARK_LEVEL + demo.SWING * light)
    assert abs(error.mean()) < 0.2
    assert error.std() == pytest.approx(np.sqrt(demo.NOISE**2 + 1 / 12), rel=0.1)


def test_turning_grating_passes_one_column_after_the_other():
    setting = Setting("sensing", 100.0, 622e-6)
    frame = testbed.record(setting, 1, seed=0, columns=41)[0].astype(float)
    pitch = testbed.DISTANCE * testbed.PIXEL_PITCH / testbed.FOCAL_LENGTH  # m at the grating
    later = 40 * pitch / testbed.speed() / demo.ROW_TIME  # rows from the first column to the last
    shifted = np.interp(np.arange(200, 500) - later, np.arange(720), frame[:, 0])
    other = np.interp(np.arange(200, 500) + later, np.arange(720), frame[:, 0])
    alike = max(np.corrcoef(each, frame[200:500, 40])[0, 1] for each in (shifted, other))
    assert alike > 0.99


def check_gains(results):
    assert gains.chi_squared(results) < chi2.ppf(0.99, 24)
    assert gains.worst_deviation(results) < 4.0


def test_gains_are_those_of_theory_and_the_rounded_bin_is_biased_where_it_must_be():
    results = [gains.measure(setting, 36, seed=1) for setting in settings()]
    assert len(results) == 24
    check_gains(results)
    for result in results:
        assert result.fit_scatter == pytest.approx(result.fit_std, rel=0.6)
        off_bin = abs(result.bin - round(result.bin))
        if off_bin < 0.02:
            assert abs(result.bias) < 5.0 * result.paper_std + 1e-3
        if result.setting.nominal == 200.0 and result.setting.kind == "sensing":  # m = 5.58
            assert result.bias == pytest.approx(-0.26 * result.setting.theory, rel=0.1)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(10))
def test_gains_are_those_of_theory_at_full_length(seed):
    check_gains([gains.measure(setting, seed=seed + 1) for setting in settings()])


def test_closed_form_deviates_as_printed():
    found = choices.deviations()
    assert round(found.loss.mean(), 4) == choices.PRINTED_MEAN
    assert round(found.loss.max(), 4) == choices.PRINTED_LARGEST
    assert found.inverse_ratio[np.argmax(found.loss)] == pytest.approx(0.34)


def test_command_draws_what_is_asked_and_prints_the_numbers(tmp_path, capsys):
    text = tmp_path / "paper.md"
    text.write_text("<!-- reproduce: test -->\n<!-- reproduce: end -->\n", encoding="utf-8")
    reproduction.main(["-o", str(tmp_path), "--frames", "2", "--text", str(text), "--figure", "5", "11"])
    for name in ("5", "11"):
        assert (tmp_path / f"figure-{name}.png").read_bytes().startswith(b"\x89PNG")
    assert "χ² = " in text.read_text(encoding="utf-8")
    lines = [line.split(" | ") for line in capsys.readouterr().out.splitlines()[2:]]
    assert [float(line[4]) for line in lines] == pytest.approx([s.theory for s in settings()], abs=1e-5)


def test_a_figure_without_gains_measures_none(tmp_path, monkeypatch):
    monkeypatch.setattr(gains, "measure", None)
    reproduction.main(["-o", str(tmp_path), "--figure", "12"])
    assert (tmp_path / "figure-12.png").exists()


def test_document_shows_every_figure():
    text = DOCUMENT.read_text(encoding="utf-8")
    for name in FIGURES:
        assert f"paper/figure-{name}.png" in text
    assert "## Table 2" in text
    assert "over 24 settings" in text
