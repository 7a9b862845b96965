"""The closed loop: never behind the closed form and the best fixed exposure; fronts; their commands."""

from __future__ import annotations

import functools
import json
import math
from pathlib import Path

import numpy as np
import pytest

import ocisac_fast as of
from ocisac_fast.cli import main
from ocisac_fast.control.drive import NOISE_LEVEL, POLICIES, RANGE, Drive, drive_past_light
from ocisac_fast.exposure import best_noisy_exposure


@functools.cache
def drive_of(hysteresis: float, noise_level: float | None = NOISE_LEVEL) -> Drive:
    return drive_past_light(seconds=1.0, hysteresis=hysteresis, noise_level=noise_level, seed=1)


class TestDrive:
    @pytest.mark.parametrize("noise_level", [NOISE_LEVEL, None])
    def test_without_hysteresis_the_controller_is_never_behind(self, noise_level: float | None) -> None:
        drive = drive_of(0.0, noise_level)
        assert np.all(drive.known[0] >= drive.known[1:].max(axis=0) * (1 - 1e-12))
        assert drive.known[0] == pytest.approx(1.0, rel=1e-12)
        if noise_level is not None:
            assert np.all(drive.true.mean(axis=1)[1:] < drive.true[0].mean() - 0.01)
            assert np.count_nonzero(drive.saturated > 0.02) <= 2  # out of the shade, once

    @pytest.mark.parametrize("hysteresis", [0.01, 0.05])
    def test_hysteresis_costs_no_more_than_itself(self, hysteresis: float) -> None:
        drive = drive_of(hysteresis)
        assert np.all(drive.known[0] * (1 + hysteresis) >= drive.known[1:].max(axis=0) * (1 - 1e-12))
        moves = [np.count_nonzero(np.diff(d.exposure[0])) for d in (drive, drive_of(0.0))]
        assert moves[0] < 0.8 * moves[1]

    def test_frames_are_measured_and_exposures_are_the_cameras(self) -> None:
        drive = drive_of(0.01)
        assert np.nanmax(np.abs(drive.seen[0] - 500.0)) < 2.0
        assert np.nanmedian(np.abs(drive.seen[1] / drive.sense_frequency - 1)) < 0.002
        steps = drive.exposure / RANGE[0]
        assert steps == pytest.approx(np.rint(steps), abs=1e-6)
        assert steps.min() >= 1

    def test_refuses(self) -> None:
        with pytest.raises(ValueError, match=r"seconds: got 0\.1, allowed"):
            drive_past_light(seconds=0.1)
        with pytest.raises(ValueError, match="seconds: got nan"):
            drive_past_light(seconds=math.nan)
        with pytest.raises(ValueError, match="seed: got -1"):
            drive_past_light(seed=-1)


class TestFront:
    def test_no_exposure_beats_an_efficient_one(self) -> None:
        front = of.exposure_front(500.0, 350.0, points=401)
        for k in range(front.exposure.size):
            better = (front.comm >= front.comm[k]) & (front.sense >= front.sense[k])
            better &= (front.comm > front.comm[k]) | (front.sense > front.sense[k])
            assert front.efficient[k] == (not better.any())

    @pytest.mark.parametrize("noise", [math.inf, 3e-4])
    def test_ours_is_on_the_front_and_the_best_of_any_weights(self, noise: float) -> None:
        random = np.random.default_rng(4)
        for _ in range(20):
            f = np.exp(random.uniform(np.log(100), np.log(3000), 2))
            weights = np.exp(random.uniform(-5, 5, 2))
            longest = 1.0 / f.min()
            front = of.exposure_front(*f, noise_exposure=noise, points=200_001)
            sums = weights[0] * front.comm + weights[1] * front.sense
            best = best_noisy_exposure(f, weights, (1e-9, longest), noise_exposure=noise)
            assert best.objective >= sums.max() * (1 - 1e-12)
            assert best.objective <= sums.max() * (1 + 1e-7)  # the grid misses the peak
            near = np.linspace(best.exposure * (1 - 1e-4), min(best.exposure * (1 + 1e-4), longest), 20_001)
            around = weights @ (near * np.abs(np.sinc(f[:, None] * near))) / np.sqrt(1 + near / noise)
            assert best.objective == pytest.approx(around.max(), rel=1e-9)

    @pytest.mark.parametrize(
        ("changed", "message"),
        [
            ({"f_comm": 0.0}, "f_comm: got 0.0"),
            ({"f_sense": math.inf}, "f_sense: got inf"),
            ({"bounds": (1.0, 1.0)}, "bounds: got 1.0 to 1.0"),
            ({"bounds": (-1.0, 1.0)}, "bounds: got -1.0 to 1.0"),
            ({"noise_exposure": 0.0}, "noise_exposure: got 0.0"),
            ({"points": 1}, "points: got 1"),
        ],
    )
    def test_refuses(self, changed: dict[str, object], message: str) -> None:
        with pytest.raises(ValueError, match=message):
            of.exposure_front(**{"f_comm": 500.0, "f_sense": 200.0, **changed})  # type: ignore[arg-type]


class TestCommands:
    def test_control(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        plot = tmp_path / "drive.png"
        assert main(["control", "--seconds", "0.5", "--json", "--plot", str(plot)]) == 0
        lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
        assert [line["policy"] for line in lines] == list(POLICIES)
        assert all(line["ahead_of_controller"] <= 0.01 for line in lines)
        assert plot.stat().st_size > 10_000

    def test_front(self, tmp_path: Path) -> None:
        front = tmp_path / "front.png"
        assert main(["exposure", "--comm", "500", "--sense", "350", "--front", str(front)]) == 0
        assert front.stat().st_size > 10_000

    def test_refuses_in_one_line(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["control", "--seconds", "0"]) == 2
        assert capsys.readouterr().err.startswith("ocisac: seconds: got 0")
