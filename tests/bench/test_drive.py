"""The closed loop: never behind the closed form and the best fixed exposure; its command."""

from __future__ import annotations

import functools
import json
import math
from pathlib import Path

import numpy as np
import pytest

from studies.command import run
from studies.drive import NOISE_LEVEL, POLICIES, RANGE, Drive, drive_past_light
from studies.drive.__main__ import drive as command


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


class TestCommand:
    def test_prints_every_policy(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        plot = tmp_path / "drive.png"
        assert run(command, ["--seconds", "0.5", "--json", "--plot", str(plot)]) == 0
        lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
        assert [line["policy"] for line in lines] == list(POLICIES)
        assert all(line["ahead_of_controller"] <= 0.01 for line in lines)
        assert plot.stat().st_size > 10_000

    def test_refuses_in_one_line(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run(command, ["--seconds", "0"]) == 2
        assert capsys.readouterr().err.startswith("drive: seconds: got 0")
