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
import timing
from PIL import Image

BENCH = Path(__file__).parents[2] / "bench"


@pytest.mark.parametrize("name", peers.PEERS)
@pytest.mark.parametrize("columns", [64, 70])
def test_peers_are_the_fourier_sum_of_the_frame(name, columns):
    library, peer = peers.PEERS[name]
    if importlib.util.find_spec(library) is None:
        pytest.skip(library)
    turns = np.arange(240)[:, None] / 240 * 6 + np.linspace(0.0, 1.0, columns)
    frame = np.rint(120.0 + 60.0 * np.cos(2.0 * np.pi * turns)).astype(np.uint8)
    line = np.exp(-2j * np.pi * 6 * np.arange(240) / 240) @ frame
    expected = 2.0 * np.abs(line) / frame.sum(axis=0, dtype=np.float64)
    np.testing.assert_allclose(peer(frame, 6), expected, atol=2e-5)


def printed(script, *arguments):
    """Standard output of a script of bench/."""
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, str(BENCH / script), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True, env=paths).stdout


@pytest.mark.nightly
def test_speed_reports_every_figure():
    report = json.loads(printed("speed.py", "--quick", "--json"))
    names = [figure["name"] for figure in report["figures"] if figure["limit"] is not None]
    assert len(set(names)) == len(names) >= 46
    assert all(figure["value"] > 0.0 for figure in report["figures"] if figure["unit"] != "%")  # rounds: may be none


def test_timing_with_everything_estimated_is_that_with_everything_known():
    arguments = ("--exposures", "0.5", "3", "7", "--frames", "1", "--json", "--check")
    settings = [json.loads(line) for line in printed("timing.py", *arguments).splitlines()]
    assert [(s["exposure_chips"], s["rows_per_chip"], s["noise"]) for s in settings] == [
        (exposure, rows, noise)
        for exposure in (0.5, 3.0, 7.0)
        for rows in (2.0, 4.0, 7.0)
        for noise in (0.01, 0.02, 0.04)
    ]
    assert all(s["chip_error_rate"] == s["chip_error_rate_genie"] == 0 for s in settings[:9])
    assert sum(s["frames_lost"] + s["frames_clock_off"] for s in settings) == 0
    assert json.loads(printed("timing.py", "--anywhere", "3", "--check"))["chips"] > 300


def test_exposures_of_fourteen_chips_do_not_let_the_clock_slip():
    assert timing.is_good(timing.measure(2.0, 14.0, 0.02, frames=24))


def test_detection_reports_every_figure_with_its_limit_reached(tmp_path):
    rows = printed("detection.py", "--frames", "4", "--check").splitlines()[1:]
    assert len(rows) == 9
    assert all(row.endswith("  reached") and int(row.split()[3]) > 100 for row in rows)
    picture = tmp_path / "detectors.png"
    printed("detection.py", "--picture", str(picture), "--frames", "1")
    assert picture.stat().st_size > 10_000


def test_link_reports_frames_and_goodput():
    links = json.loads(printed("link.py", "--starts", "1", "--json", "--check"))["links"]
    assert [link["exposure_given"] for link in links] == [True, True, True, False]
    assert all(84 <= link["frames"] <= 130 and 1800 < link["goodput"] < 2420 for link in links)


def test_motion_reports_both_tables():
    rows = [json.loads(line) for line in printed("motion.py", "--frames", "2").splitlines()]
    assert all(0.9 < row["stated_over_bound"] < 1.2 for row in rows[:3])
    assert all(abs(row["after"] - row["expected"]) < 5 * row["after_std"] for row in rows[3:])


@pytest.mark.parametrize("part", ["track", "locate"])
def test_sensing_reports_every_measure_with_its_aim(part):
    report = json.loads(printed("sensing.py", "--quick", "--only", part, "--json"))
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


def write_pictures(folder):
    """A picture of noise, and one with a disk of bars, which looks like a lamp."""
    random = np.random.default_rng(0)
    noise = 90.0 + 3.0 * random.standard_normal((2, 260, 320))
    y, x = np.ogrid[:260, :320]
    noise[1] += np.where(np.hypot(y - 130, x - 160) < 60, 60.0 * np.sin(2 * np.pi * y / 13.0), 0.0)
    for k, picture in enumerate(noise):
        Image.fromarray(np.clip(np.rint(picture), 0, 255).astype(np.uint8)).save(folder / f"{k}.png")


def test_false_lights_of_photographs_and_of_bursts_of_them_are_counted(tmp_path):
    write_pictures(tmp_path)
    report = json.loads(printed("photographs.py", "--photographs", str(tmp_path), "--lamps"))
    assert (report["looks"], report["false_at_0.01"], report["asked_at_0.1"]) == (4, 1, 0.4)
    assert report["reported"] >= 1
    report = json.loads(printed("films.py", str(tmp_path), "--bursts", "--frames", "3", "--no-clean"))
    assert report["films"]["0"] == {"frames": 3, "with_lights": 0, "answers_with_bits": 0, "changed": 0}
    assert report["frames"] == 6
