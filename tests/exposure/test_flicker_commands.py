"""Flickering lights on the command line: what is printed, what is refused, and help that fits on a screen."""

import json
import subprocess
import sys

import pytest

pytest.importorskip("click")
pytest.importorskip("rich")

from ocisac_fast.cli import main


@pytest.fixture
def facts(capsys):
    """Runs a command with --json, which must succeed: its objects."""

    def call(*arguments):
        assert main([*arguments, "--json"]) == 0
        captured = capsys.readouterr()
        assert captured.err == ""
        return [json.loads(line, parse_constant=pytest.fail) for line in captured.out.splitlines()]

    return call


def test_shortest_exposure_for_both_mains(facts):
    (found,) = facts("exposure", "--avoid", "100Hz,120Hz", "--below", "2%")
    assert f"{found['exposure_s']:.4f}" == "0.0490"
    assert found["holds"] is True
    assert 0.0199 < found["modulation"] <= 0.02
    assert [light["frequency_hz"] for light in found["lights"]] == [100, 120]
    (drifting,) = facts("exposure", "--avoid", "mains", "--below", "2%")
    assert found["exposure_s"] < drifting["exposure_s"] < 0.05


def test_lights_nearest_steps_and_data(facts):
    (found,) = facts("exposure", "--avoid", "90Hz+-1%:0.1,500Hz:square,100Hz±0.5Hz", "--below", "0.05")
    assert [light["duty"] for light in found["lights"]] == [0.1, 0.5, None]
    assert [light["frequency_uncertainty_hz"] for light in found["lights"]] == pytest.approx([0.9, 0.0, 0.5])
    (near,) = facts("exposure", "--avoid", "100Hz", "--near", "22ms", "--step", "22.2us", "--below", "2%")
    assert near["exposure_s"] / 22.2e-6 == pytest.approx(round(near["exposure_s"] / 22.2e-6))
    assert abs(near["exposure_s"] - 20.4e-3) < 1e-4
    (kept,) = facts("exposure", "--avoid", "100Hz", "--comm", "30Hz", "--keep", "80%")
    assert kept["holds"]
    assert kept["gain"] > 0.8
    (both,) = facts("exposure", "--avoid", "100Hz", "--comm", "35Hz", "--sense", "20Hz", "--bounds", "1ms,50ms")
    assert both["holds"]
    assert both["objective"] > 0


def test_what_cannot_be_had_is_the_best_there_is(facts):
    for arguments in (
        ("--avoid", "100Hz,120Hz", "--bounds", "1ms,20ms"),
        ("--avoid", "1kHz+-500Hz", "--bounds", "0,5ms"),
        ("--avoid", "100Hz", "--comm", "101Hz", "--keep", "50%"),
    ):
        (found,) = facts("exposure", *arguments)
        assert found["holds"] is False
        assert found["modulation"] > 0.02


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("exposure --avoid 100Hz+-100Hz", "uncertainty: got 100.0"),
        ("exposure --avoid 100Hz:2", "duty: got 2.0"),
        ("exposure --avoid soon", "Invalid value for '--avoid': got 'soon', allowed: 100Hz"),
        ("exposure --avoid 100Hz --below 0", "below: got 0,"),
        ("exposure --avoid 100Hz --below much", "Invalid value for '--below': got 'much'"),
        ("exposure --avoid 100Hz --bounds 3ms,2ms", "bounds: got 0.003 to 0.002"),
        ("exposure --avoid 100Hz --bounds 0,0", "bounds: got 0 to 0,"),
        ("exposure --avoid 100Hz --step 30ms --bounds 31ms,40ms", "step: got 0.03"),
        ("exposure --avoid 100Hz --keep 50%", "--comm: needed"),
        ("exposure --avoid 100Hz --comm 100Hz", "f_comm: got 100, allowed: none of the lights to avoid"),
        ("exposure --avoid 100Hz --method search", "--method: got search"),
        ("exposure --comm 100 --sense 50 --near 1ms", "--near: needs --avoid"),
        ("flicker --lights 90Hz --exposures 0", "exposure: got"),
        ("flicker --lights 90Hz --exposures 1ms --background -1", "background: got -1.0"),
        ("lamp --exposures 0ms", "exposures: got"),
        ("lamp --exposures 1ms --range 50Hz", "--range: got 1 frequencies"),
        ("lamp --exposures 1ms --duty 1", "duty: got 1.0"),
    ],
)
def test_bad_input_is_one_line(capsys, arguments, message):
    assert main(arguments.split()) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert message in line


def test_pictures(tmp_path, facts):
    pytest.importorskip("matplotlib")
    modulation, front = tmp_path / "modulation.png", tmp_path / "front.png"
    facts(
        *("exposure", "--avoid", "mains", "--comm", "35Hz", "--keep", "5%"),
        *("--plot", str(modulation), "--front", str(front)),
    )
    assert modulation.stat().st_size > 10_000
    assert front.stat().st_size > 10_000


@pytest.mark.parametrize("command", ["exposure", "flicker", "lamp"])
def test_help_fits_on_a_screen(command):
    shown = subprocess.run(
        [sys.executable, "-m", "ocisac_fast.cli", command, "--help"], capture_output=True, text=True, check=True
    )
    lines = shown.stdout.splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80


def test_indices_of_lamps_under_exposures(facts, tmp_path):
    pytest.importorskip("matplotlib")
    picture = tmp_path / "indices.png"
    found = facts("flicker", "--lights", "90Hz:0.1,500Hz:square", "--exposures", "1ms,11ms", "--plot", str(picture))
    assert [(one["frequency_hz"], one["exposure_s"]) for one in found] == [
        (90, 1e-3),
        (90, 0.011),
        (500, 1e-3),
        (500, 0.011),
    ]
    assert found[0]["missed"] == pytest.approx(1 - 0.09 - 0.1)
    assert found[0]["detection_index"] == pytest.approx(0.19)
    assert found[3]["modulation_index"] == pytest.approx(1 / 11)
    assert picture.stat().st_size > 10_000


def test_lamps_for_shutters(facts, tmp_path):
    pytest.importorskip("matplotlib")
    shutters = ("--exposures", "1/60s,1/100s", "--plot", str(tmp_path / "lamp.png"))
    (found,) = facts("lamp", *shutters, "--duty", "0.1", "--below", "2%", "--range", "50Hz,1kHz")
    assert (tmp_path / "lamp.png").stat().st_size > 10_000
    assert found["holds"]
    assert found["frequencies_hz"][0] == pytest.approx([298.82, 301.22], abs=0.01)
    assert found["no_missed_pulse_from_hz"] == pytest.approx(90)
    assert found["chip_rates_from_hz"]["manchester"] == pytest.approx(10_000)
    (none,) = facts("lamp", "--exposures", "1/60s,1/100s", "--range", "50Hz,90Hz")
    assert none["holds"] is False
    (duties,) = facts("lamp", "--exposures", "1ms", "--frequency", "90Hz")
    assert duties["no_missed_pulse_from_duty"] == pytest.approx(0.91)
