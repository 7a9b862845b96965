"""The peers of bench/speed.py give the right gain, and its report is what it says."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import peers
import pytest

BENCH = Path(__file__).parents[2] / "bench"


@pytest.mark.parametrize("name", peers.PEERS)
@pytest.mark.parametrize("columns", [64, 70])
def test_peers_are_the_fourier_sum_of_the_frame(name, columns):
    library, make = peers.PEERS[name]
    if importlib.util.find_spec(library) is None:
        pytest.skip(library)
    turns = np.arange(240)[:, None] / 240 * 6 + np.linspace(0.0, 1.0, columns)
    frame = np.rint(120.0 + 60.0 * np.cos(2.0 * np.pi * turns)).astype(np.uint8)
    line = np.exp(-2j * np.pi * 6 * np.arange(240) / 240) @ frame
    expected = 2.0 * np.abs(line) / frame.sum(axis=0, dtype=np.float64)
    np.testing.assert_allclose(make(240, columns, 6)(frame), expected, atol=2e-5)


@pytest.mark.nightly
def test_speed_reports_every_figure():
    command = [sys.executable, str(BENCH / "speed.py"), "--quick", "--json"]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True, env=paths).stdout)
    names = [figure["name"] for figure in report["figures"] if figure["limit"] is not None]
    assert len(set(names)) == len(names) >= 49
    assert all(figure["value"] > 0.0 for figure in report["figures"] if figure["unit"] != "%")  # rounds: may be none


def test_timing_reports_every_figure():
    command = [sys.executable, str(BENCH / "timing.py"), "--frames", "1", "--longest", "0.5", "--json"]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    printed = subprocess.run(command, check=True, capture_output=True, text=True, env=paths).stdout
    settings = [json.loads(line) for line in printed.splitlines()]
    assert [(s["rows_per_chip"], s["noise"]) for s in settings[:4]] == [
        (2.0, 0.01),
        (2.0, 0.02),
        (2.0, 0.04),
        (4.0, 0.01),
    ]
    assert all(s["chip_error_rate"] == s["chip_error_rate_genie"] == 0 for s in settings)
    assert all(s["frames_lost"] == s["frames_clock_off"] == 0 for s in settings)


def test_detection_reports_every_figure_with_its_limit_reached():
    command = [sys.executable, str(BENCH / "detection.py"), "--frames", "4", "--json", "--check"]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    printed = subprocess.run(command, check=True, capture_output=True, text=True, env=paths).stdout
    results = json.loads(printed)["results"]
    assert len(results) == 9
    assert all(r["reached"] and r["chips"] > 100 for r in results)


def test_detection_with_everything_estimated_is_that_with_everything_known(tmp_path):
    command = [
        sys.executable,
        str(BENCH / "detection.py"),
        "--estimated",
        "--quick",
        "--frames",
        "1",
        "--json",
        "--check",
    ]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    printed = subprocess.run(command, check=True, capture_output=True, text=True, env=paths).stdout
    settings = [json.loads(line) for line in printed.splitlines()]
    assert len(settings) == 27
    assert sum(s["frames_lost"] + s["frames_clock_off"] for s in settings) == 0
    picture = tmp_path / "detectors.png"
    subprocess.run([*command[:2], "--picture", str(picture), "--frames", "1"], check=True, env=paths)
    assert picture.stat().st_size > 10_000


def test_link_reports_frames_goodput_and_speed():
    command = [sys.executable, str(BENCH / "link.py"), "--starts", "1", "--no-speed", "--json", "--check"]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    printed = subprocess.run(command, check=True, capture_output=True, text=True, env=paths).stdout
    links = json.loads(printed)["links"]
    assert [link["exposure_given"] for link in links] == [True, True, True, False]
    assert all(84 <= link["frames"] <= 130 and 1800 < link["goodput"] < 2420 for link in links)


def test_motion_reports_both_tables():
    command = [sys.executable, str(BENCH / "motion.py"), "--frames", "2", "--json"]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    printed = subprocess.run(command, check=True, capture_output=True, text=True, env=paths).stdout
    rows = [json.loads(line) for line in printed.splitlines()]
    assert all(0.9 < row["stated_over_bound"] < 1.2 for row in rows[:3])
    assert all(abs(row["after"] - row["expected"]) < 5 * row["after_std"] for row in rows[3:])


@pytest.mark.parametrize("part", ["track", "front", "locate"])
def test_sensing_reports_every_measure_with_its_aim(part):
    command = [sys.executable, str(BENCH / "sensing.py"), "--quick", "--only", part, "--json"]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True, env=paths).stdout)
    assert all(one["part"] == part for one in report["measures"])
    assert all(one["reached"] for one in report["measures"] if "frame/s" not in one["name"])  # the machine may be busy


def test_lights_found_are_told_from_what_is_none(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCH))
    import light_scenes

    frame, truth, noise = light_scenes.scene(np.random.default_rng(3), 6, "even")
    assert len(truth) == 6
    assert noise > 0
    found = light_scenes.detect_sources(frame, light_scenes.CAMERA)
    hits, true = light_scenes.judge(found, truth)
    assert sum(hits) == sum(true) >= 3
    moved = [{**light, "row": light["row"] + 300.0} for light in truth]
    assert not any(light_scenes.judge(found, moved)[1])
