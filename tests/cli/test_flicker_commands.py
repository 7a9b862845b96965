"""Flickering lights on the command line: what is printed, what is refused, and help that fits on a screen."""

import pytest


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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("exposure --avoid 100Hz+-100Hz", "uncertainty: got 100.0"),
        ("exposure --avoid soon", "Invalid value for '--avoid': got 'soon', allowed: 100Hz"),
        ("exposure --avoid 100Hz --below 0", "below: got 0,"),
        ("exposure --avoid 100Hz --below much", "Invalid value for '--below': got 'much'"),
        ("exposure --avoid 100Hz --bounds 3ms,2ms", "bounds: got 0.003 to 0.002"),
        ("exposure --avoid 100Hz --keep 50%", "--comm: needed"),
        ("exposure --avoid 100Hz --comm 100Hz", "--comm: got 100, allowed: none of the lights to avoid"),
        ("exposure --avoid 100Hz --method search", "--method: got search"),
        ("exposure --comm 100 --sense 50 --near 1ms", "--near: needs --avoid"),
        ("flicker --lights 90Hz --exposures 0", "exposure: got"),
        ("lamp --exposures 0ms", "exposures: got"),
        ("lamp --exposures 1ms --range 50Hz", "Invalid value for '--range': got '50Hz', allowed: LOW..HIGH"),
        ("lamp --exposures 1ms --duty 1", "--duty: got 1.0"),
        ("lamp --exposures 1ms..2ms", "got '1ms..2ms', allowed: LOW..HIGH:COUNT"),
        ("lamp --exposures 2ms..1ms:9", "allowed: LOW..HIGH:COUNT"),
        ("flicker --lights 90Hz:3 --exposures 1ms", "(duty: got 3.0,"),
        ("flicker --lights 90Hz:5%:3 --exposures 1ms", "got '90Hz:5%:3', allowed:"),
        ("flicker --lights 90Hz..80Hz --exposures 1ms", "(range: got 90..80:5, allowed:"),
        ("exposure --comm 0 --sense 50", "Invalid value for '--comm': got 0 Hz"),
    ],
)
def test_bad_input_is_one_line(run, arguments, message):
    code, out, (line,) = run(*arguments.split())
    assert (code, out) == (2, [])
    assert message in line


def test_pictures(tmp_path, facts):
    modulation, front = tmp_path / "modulation.png", tmp_path / "front.png"
    shown = ("--plot", modulation, "--front", front)
    facts("exposure", "--avoid", "mains", "--comm", "35Hz", "--keep", "5%", *shown)
    assert modulation.stat().st_size > 10_000
    assert front.stat().st_size > 10_000


@pytest.mark.parametrize("command", ["exposure", "flicker", "lamp"])
def test_help_fits_on_a_screen(program, command):
    lines = program(command, "--help", check=True).stdout.splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80


def test_indices_of_lamps_under_exposures(facts, tmp_path):
    picture = tmp_path / "indices.png"
    found = facts("flicker", "--lights", "90Hz:0.1,500Hz:square", "--exposures", "1ms,11ms", "--plot", str(picture))
    asked = [(90, 1e-3), (90, 0.011), (500, 1e-3), (500, 0.011)]
    assert [(one["frequency_hz"], one["exposure_s"]) for one in found] == asked
    assert found[0]["missed"] == pytest.approx(1 - 0.09 - 0.1)
    assert found[0]["detection_index"] == pytest.approx(0.19)
    assert found[3]["modulation_index"] == pytest.approx(1 / 11)
    assert picture.stat().st_size > 10_000


def test_lamps_for_shutters(facts, tmp_path):
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


def test_ranges_are_all_lamps_and_exposures(facts):
    found = facts("flicker", "--lights", "90Hz..200Hz:3:5%..40%:2,1kHz:1/32", "--exposures", "10us..10ms:4,11ms")
    assert len(found) == 7 * 5
    assert sorted({one["frequency_hz"] for one in found}) == [90, 145, 200, 1000]
    assert sorted({one["duty"] for one in found}) == pytest.approx([1 / 32, 0.05, 0.4])
    assert sorted({one["exposure_s"] for one in found}) == pytest.approx([1e-5, 1e-4, 1e-3, 1e-2, 1.1e-2])
    assert len(facts("flicker", "--lights", "90Hz..200Hz", "--exposures", "1ms")) == 5


def test_a_range_to_avoid_is_one_light_of_any_frequency(facts):
    (found,) = facts("exposure", "--avoid", "95Hz..105Hz:20%..50%", "--below", "5%", "--bounds", "1ms..0.5s")
    (light,) = found["lights"]
    assert (light["frequency_hz"], light["frequency_uncertainty_hz"], light["duty"]) == (100, 5, 0.2)
    (each,) = facts("exposure", "--avoid", "95Hz..105Hz:3", "--below", "50%")
    assert len(each["lights"]) == 3


def test_a_null_beside_the_edge_is_named(facts):
    (found,) = facts("exposure", "--avoid", "100Hz")
    assert found["exposure_s"] < 0.0099
    assert found["null_s"] == pytest.approx(0.01)
    (near,) = facts("exposure", "--avoid", "100Hz", "--near", "10ms")
    assert near["exposure_s"] == pytest.approx(0.01)
    assert "null_s" not in near


def test_a_frequency_that_no_camera_shows(facts, run):
    arguments = ("lamp", "--exposures", "1/50s,1/100s,1/25s,1/60s,1/30s", "--duty", "1/32")
    (found,) = facts(*arguments)
    assert found["best_hz"][0] == pytest.approx(300.0)
    assert found["frequencies_hz"][0] == pytest.approx([299.6, 300.4], abs=0.05)
    code, out, _ = run(*arguments)
    assert code == 0
    assert max(map(len, out)) <= 80


def test_frequencies_that_are_equally_bad_are_said_to_be(run):
    code, out, _ = run("lamp", "--exposures", "10us", "--range", "50Hz..200Hz", "--duty", "10%")
    assert code == 0
    assert "every frequency from 50 Hz to 200 Hz is equally bad" in " ".join(out)
