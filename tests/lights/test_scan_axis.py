"""The read-out axis that a picture shows."""

import json

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


@pytest.mark.filterwarnings("ignore")
def test_commands_find_the_axis_and_name_it(tmp_path, run):
    file, gains = tmp_path / "lamp.npy", []
    needs = {
        "detect": ["--row-time", "10us"],
        "calibrate": ["--frequency", "9kHz"],
        "gain": ["--row-time", "10us", "--exposure", "30us", "--frequency", "9kHz"],
        "receive": ["--row-time", "10us", "--exposure", "30us", "--chip-rate", "18kHz"],
        "clean": [tmp_path / "clean.npy", "--force"],
    }
    for turned, axis in ((False, "y"), (True, "x")):
        np.save(file, picture("lamp").T if turned else picture("lamp"))
        region = ["--region", "115,185,50,30" if turned else "185,115,30,50"]  # within the lamp
        found = {}
        for command, words in needs.items():
            words = [command, file, *words, *(region if command == "gain" else [])]
            code, out, _ = run(*words, "--json")
            found[command] = json.loads(*out)
            assert (code, found[command]["scan_axis"]) == (0, axis)
            if command in ("detect", "receive"):
                assert ("scan axis x" in " ".join(run(*words)[1])) == turned
        assert found["detect"]["sources"][0]["frequency_hz"] == pytest.approx(9e3, rel=0.01)
        assert found["calibrate"]["row_time_s"] == pytest.approx(1e-5, rel=0.01)
        assert (found["gain"]["rows"], found["receive"]["rows"]) == (50, 300)
        gains.append(found["gain"]["gain"])
    assert gains[0] == gains[1] > 0.2


@pytest.mark.parametrize("command", ["gain", "calibrate", "detect", "receive", "clean"])
def test_a_stated_axis_that_does_not_fit_is_told(tmp_path, run, command):
    file = tmp_path / "lamp.npy"
    needs = {"gain": ["--frequency", "0.09"], "calibrate": ["--frequency", "9kHz"], "clean": [str(tmp_path / "c.npy")]}
    for turned in (False, True):
        np.save(file, picture("lamp").T if turned else picture("lamp"))
        for axis in ("y", "x", "-y", "-x"):
            code, _, err = run(command, file, *needs.get(command, []), "--scan-axis", axis, "--json", "--force")
            told = [line for line in err if "--scan-axis" in line]
            assert code == 0
            assert len(told) == int(axis.endswith("x") != turned)
            assert all(line.endswith(f"probably --scan-axis {'x' if turned else 'y'}") for line in told)


def test_an_axis_that_is_not_clear_is_told(tmp_path, run):
    light = 80.0 * integrate_exposure(SquareWave(9e3), CAMERA, 400)
    y, x = np.ogrid[:400, :400]
    values = 60.0 + light[:, None] * (np.hypot(y - 100, x - 100) < 40) + light * (np.hypot(y - 300, x - 300) < 40)
    both = np.rint(values + np.random.default_rng(0).standard_normal((400, 400))).astype(np.uint8)
    assert not find_scan_axis(both, CAMERA).clear
    file = tmp_path / "lamps.npy"
    np.save(file, both)
    code, _, err = run("detect", file, "--json")
    assert code == 0
    assert "--scan-axis: not clear" in " ".join(err)
    np.save(file, picture(None))
    assert run("detect", file, "--json")[::2] == (0, [])
