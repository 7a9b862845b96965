"""The closed loop: never behind the closed form and the best fixed exposure."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest

from studies.drive import __main__ as command
from studies.drive.simulation import NOISE_LEVEL, POLICIES, RANGE, Drive, drive_past_light


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

    def test_command_prints_every_policy(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        plot = tmp_path / "drive.png"
        command.main(["--seconds", "0.5", "--plot", str(plot)])
        lines = capsys.readouterr().out.splitlines()[2:]
        assert [line.split(" | ")[0] for line in lines] == [f"| {policy}" for policy in POLICIES]
        controller, *others = (float(line.split(" | ")[-1].strip(" |")) for line in lines)
        assert controller * 1.01 >= max(others)
        assert plot.stat().st_size > 10_000
