"""The read-out axis that a picture shows."""

import json
import warnings

import numpy as np
import pytest

from ocisac_fast import Camera, SquareWave, Tone, integrate_exposure
from ocisac_fast.lights import find_scan_axis

CAMERA = Camera(1e-5, exposure=3e-5)


def picture(kind, seed=0):
    """Bytes (rows, columns): a lamp, or a light everywhere, over a texture; None: no light."""
    random = np.random.default_rng(seed)
    values = 60.0 + 20.0 * np.sin(np.arange(300) / 40.0)[:, None] * np.cos(np.arange(400) / 30.0)
    y, x = np.ogrid[:300, :400]
    if kind == "lamp":
        light = integrate_exposure(SquareWave(9e3), CAMERA, 300)[:, None]
        values = values + 80.0 * light * (np.hypot(y - 140, x - 200) < 40)
    if kind == "everywhere":  # too slow for a lamp of 2.5 cycles
        values = values * (0.5 + integrate_exposure(Tone(6e2), CAMERA, 300)[:, None])
    return np.clip(np.rint(values + random.standard_normal(values.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["lamp", "everywhere"])
def test_the_axis_is_that_of_the_light(kind, seed):
    for turned in (False, True):
        frame = picture(kind, seed)
        found = find_scan_axis(frame.T if turned else frame, CAMERA)
        assert found.axis == ("x" if turned else "y")
        assert found.clear
        assert len(found.energy) == len(found.probability) == len(found.coherence) == 2
        assert max(found.probability) > 0.99 or kind == "everywhere"


def test_without_a_light_no_axis_is_clear():
    assert not find_scan_axis(picture(None), CAMERA).clear
    assert find_scan_axis(np.full((8, 8), 9, np.uint8), CAMERA).axis == "y"


def test_commands_find_the_axis_and_name_it(tmp_path, capsys):
    for module in ("click", "rich"):
        pytest.importorskip(module)
    from ocisac_fast.cli import main

    file, gains = tmp_path / "lamp.npy", []
    for turned, axis in ((False, "y"), (True, "x")):
        frame = picture("lamp")
        np.save(file, frame.T if turned else frame)
        assert main(["detect", str(file), "--row-time", "10us", "--json"]) == 0
        (found,) = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
        assert found["scan_axis"] == axis
        assert found["sources"][0]["frequency_hz"] == pytest.approx(9e3, rel=0.01)
        assert main(["calibrate", str(file), "--frequency", "9kHz", "--json"]) == 0
        measured = json.loads(capsys.readouterr().out)
        assert measured["scan_axis"] == axis
        assert measured["row_time_s"] == pytest.approx(1e-5, rel=0.01)
        assert main(["detect", str(file), "--row-time", "10us"]) == 0
        assert ("scan axis x" in capsys.readouterr().out) == turned
        options = ["--row-time", "10us", "--exposure", "30us"]
        region = ["--region", "115,185,50,30" if turned else "185,115,30,50"]  # within the lamp
        assert main(["gain", str(file), *options, *region, "--frequency", "9kHz", "--json"]) == 0
        gain = json.loads(capsys.readouterr().out)
        assert (gain["scan_axis"], gain["rows"]) == (axis, 50)
        gains.append(gain["gain"])
        assert main(["receive", str(file), *options, "--chip-rate", "18kHz", "--json"]) == 0
        received = json.loads(capsys.readouterr().out)
        assert (received["scan_axis"], received["rows"]) == (axis, 300)
        assert main(["receive", str(file), *options]) == 0
        assert ("scan axis x" in capsys.readouterr().out) == turned
        assert main(["clean", str(file), str(tmp_path / "clean.npy"), "--json", "--force"]) == 0
        assert json.loads(capsys.readouterr().out)["scan_axis"] == axis
    assert gains[0] == gains[1] > 0.2


@pytest.mark.parametrize("command", ["gain", "calibrate", "detect", "receive", "clean"])
def test_a_stated_axis_that_does_not_fit_is_told(tmp_path, capsys, monkeypatch, command):
    for module in ("click", "rich"):
        pytest.importorskip(module)
    from ocisac_fast.cli import main

    file = tmp_path / "lamp.npy"
    needs = {"gain": ["--frequency", "0.09"], "calibrate": ["--frequency", "9kHz"], "clean": [str(tmp_path / "c.npy")]}
    for turned in (False, True):
        np.save(file, picture("lamp").T if turned else picture("lamp"))
        for axis in ("y", "x", "-y", "-x"):
            words = [command, str(file), *needs.get(command, []), "--scan-axis", axis, "--json"]
            monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)  # put back after the run
            with warnings.catch_warnings():
                warnings.simplefilter("default")
                assert main(words + (["--force"] if command == "clean" else [])) == 0
            told = [line for line in capsys.readouterr().err.splitlines() if "--scan-axis" in line]
            assert len(told) == int(axis.endswith("x") != turned)
            assert all(line.endswith(f"probably --scan-axis {'x' if turned else 'y'}") for line in told)


def test_an_axis_that_is_not_clear_is_told(tmp_path, capsys, monkeypatch):
    for module in ("click", "rich"):
        pytest.importorskip(module)
    from ocisac_fast.cli import main

    light = 80.0 * integrate_exposure(SquareWave(9e3), CAMERA, 400)
    y, x = np.ogrid[:400, :400]
    values = 60.0 + light[:, None] * (np.hypot(y - 100, x - 100) < 40) + light * (np.hypot(y - 300, x - 300) < 40)
    both = np.rint(values + np.random.default_rng(0).standard_normal((400, 400))).astype(np.uint8)
    assert not find_scan_axis(both, CAMERA).clear
    file = tmp_path / "lamps.npy"
    np.save(file, both)
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)  # put back after the run
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert main(["detect", str(file), "--json"]) == 0
    assert "--scan-axis: not clear" in capsys.readouterr().err
    np.save(file, picture(None))
    assert main(["detect", str(file), "--json"]) == 0
    assert capsys.readouterr().err == ""
