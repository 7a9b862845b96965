"""The chart: its methods are right where they should be, its bound is a bound, its outputs hold what was measured."""

from __future__ import annotations

import csv
import dataclasses

import numpy as np
import pytest

from studies.chart import __main__ as command, measuring, panels
from studies.chart.methods import GAIN_METHODS
from studies.chart.scenes import SCENES, Scene, odd_harmonics
from studies.reporting import fill_markers

METHODS = {method.name: method for method in GAIN_METHODS}
CLEAN = Scene("clean", "clean", 25.0, mean=120.0, noise=0.3, rows=480, columns=64)


@pytest.mark.parametrize("name", METHODS)
def test_every_method_finds_the_gain_of_a_tone_on_a_bin(name):
    if not METHODS[name].installed:
        pytest.skip(METHODS[name].needs)
    (frame,) = CLEAN.frames(1)
    gains = METHODS[name].prepare(CLEAN)(frame)
    assert gains.shape == (64,)
    np.testing.assert_allclose(gains, CLEAN.gain, atol=2e-3)


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_the_fit_with_harmonics_attains_the_bound_and_nothing_beats_it(scene):
    smaller = dataclasses.replace(scene, columns=600)
    fit = METHODS["fit with harmonics, kernel 26 bits, D=1"].prepare(smaller)
    errors = np.concatenate([fit(frame) - scene.gain for frame in smaller.frames(2)])
    spread = np.sqrt(np.mean(errors**2)) / scene.bound()
    assert 0.9 < spread < 1.1  # 1200 columns: 2 % of uncertainty


@pytest.mark.parametrize(("scene", "name", "times"), [("off-bin", "rounded bin", 50), ("few-cycles", "DTFT", 50)])
def test_plain_methods_fail_where_the_chart_says(scene, name, times):
    smaller = dataclasses.replace(next(s for s in SCENES if s.name == scene), columns=100)
    estimate = METHODS[f"{name}, kernel"].prepare(smaller)
    (frame,) = smaller.frames(1)
    assert np.sqrt(np.mean((estimate(frame) - smaller.gain) ** 2)) > times * smaller.bound()


def test_square_light_is_the_average_of_its_samples():
    scene = dataclasses.replace(CLEAN, waveform="square", exposure_cycles=0.37, depth=0.9)
    instants = 0.2 + np.arange(480)[:, None] * 25 / 480 - (np.arange(20000) + 0.5) / 20000 * 0.37
    bright = np.abs(instants - np.rint(instants)) < 0.25
    expected = 120.0 * (1.0 + 0.9 * (2.0 * bright.mean(axis=1) - 1.0))
    np.testing.assert_allclose(scene.light([0.2])[:, 0], expected, atol=0.05)


def test_scenes_are_the_same_in_every_run():
    first, second = (next(CLEAN.frames(1)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("row_group", [1, 2, 4, 8])
def test_harmonics_kept_stay_apart_after_folding(row_group):
    orders = odd_harmonics(5.3 / 1080, 1080, row_group)
    cycles = np.array(orders) * 5.3 / 1080 * row_group
    folded = np.sort(np.abs((cycles + 0.5) % 1.0 - 0.5)) / row_group
    assert orders[0] == 1
    assert np.all(np.diff(folded) * 1080 >= 1.0 - 1e-9)


class Clock:
    """Stands in for the time module; calls make the time that they take pass."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        monkeypatch.setattr(measuring, "time", self)

    def perf_counter(self):
        return self.now

    def call(self, seconds):
        def run(item):
            self.now += seconds * item

        return run


def test_times_are_ratios_of_neighbouring_calls(monkeypatch):
    clock = Clock(monkeypatch)
    timing = measuring.in_turn(clock.call(0.04), clock.call(0.001), [1.0, 2.0, 1.0], 1.0, (5, 80))
    assert timing.pairs > 5
    assert timing.ratio == pytest.approx(40.0)  # the median: one of three neighbours differs
    assert timing.seconds == pytest.approx(0.04)


def test_the_fastest_tenth_is_what_no_other_work_slows(monkeypatch):
    clock = Clock(monkeypatch)
    slowed = [30.0 if k % 3 else 1.0 for k in range(40)]  # the calls fall on other items in turn
    timing = measuring.in_turn(clock.call(0.01), clock.call(0.005), [*slowed, 1.0], 60.0, (5, 400))
    assert timing.undisturbed == pytest.approx(2.0)


def test_blocks_leave_out_what_follows_a_change_of_call(monkeypatch):
    clock = Clock(monkeypatch)
    calls = []

    def call(_):
        clock.now += 0.002 if calls[-1:] == ["call"] else 5.0  # the first of a block finds the caches full
        calls.append("call")

    def yardstick(_):
        clock.now += 0.001
        calls.append("yardstick")

    timing = measuring.in_blocks(call, yardstick, [0], 0.0, blocks=(4, 4), fewest=3)
    assert calls == 3 * (4 * ["call"] + 4 * ["yardstick"])
    assert timing.seconds == pytest.approx(0.002)
    assert timing.ratio == pytest.approx(2.0)
    assert timing.pairs == 3


def point(name, cost, error, family="family"):
    method = dataclasses.replace(GAIN_METHODS[0], name=name, family=family, precision="float32")
    return panels.Point("p", method, cost, error, cost)


def test_front_holds_what_no_other_beats():
    points = [point("a", 1, 5), point("b", 2, 3), point("c", 3, 4), point("d", 4, np.nan)]
    assert [p.method.name for p in panels.pareto_front(points)] == ["a", "b"]
    assert panels.beaten_by(points[2], points) is points[1]
    assert panels.beaten_by(points[0], points) is None
    assert panels.beaten_by(point("f", 2.1, 3.0), points) is None  # within the spread of the measure


def test_rows_added_are_measured_for_the_fits_alone(monkeypatch):
    monkeypatch.setattr(panels, "SCENES", [CLEAN])
    monkeypatch.setattr(panels, "FAST_TONE", dataclasses.replace(panels.FAST_TONE, rows=480, columns=64))
    (_, every), (scene, fits) = panels.measure(64, 1, 0.001, lambda _: None)
    assert {p.family for p in every} >= {"fit", "DTFT", "Goertzel"}
    assert {p.method.family for p in fits} == {"fit"}
    assert len({p.family for p in fits}) == 4
    of = {p.method.name: p.error for p in fits}
    assert of["fit, kernel 26 bits, D=8"] > 1.2 * of["fit, kernel 26 bits, D=1"]
    assert scene.name == "rows-added"


def test_command_writes_picture_table_and_text(tmp_path, monkeypatch):
    points = [point("fast", 1.5, 30.0, "DTFT"), point("right", 8.0, 1.02, "fit"), point("slow", 9.0, 1.03, "Goertzel")]
    monkeypatch.setattr(command, "measure", lambda *_: [(CLEAN, points)])
    text = tmp_path / "text.md"
    text.write_text("before\n<!-- chart: clean -->\nold\n<!-- chart: end -->\nafter <!-- chart: end -->\n")
    command.main(["--quick", "--directory", str(tmp_path), "--text", str(text)])
    assert (tmp_path / "chart.png").stat().st_size > 5000
    with open(tmp_path / "chart.csv", encoding="utf-8") as file:
        assert [(row["method"], row["on_front"]) for row in csv.DictReader(file)] == [
            ("fast", "True"),
            ("right", "True"),
            ("slow", "False"),
        ]
    written = text.read_text()
    assert "| right | 8 | 1.02 |" in written
    assert "old" not in written
    assert written.startswith("before\n<!-- chart: clean -->\n")
    assert written.endswith("\n<!-- chart: end -->\nafter <!-- chart: end -->\n")
    assert "| clean | right | 8 | 1.02 | none |" in command.blocks([(CLEAN, points)], True)["fit"]


@pytest.mark.parametrize("content", ["nothing here\n", "<!-- chart: other -->\n<!-- chart: end -->\n"])
def test_text_without_known_markers_is_refused_and_left_alone(tmp_path, content):
    text = tmp_path / "text.md"
    text.write_text(content)
    with pytest.raises(ValueError, match="marker"):
        fill_markers(text, "chart", {"setting": "none"})
    assert text.read_text() == content
