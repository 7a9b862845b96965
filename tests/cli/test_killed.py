"""SIGKILL at any time leaves the old file or the new one, never a part of it."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from pathlib import Path

import pytest

KILLS = 3
PROGRAM = [str(Path(sys.executable).with_name("ocisac"))]
SIMULATE = ["simulate", "--frequency", "900", "--row-time", "20us", "--exposure", "100us", "--columns", "160"]


def seconds_of(command: list[str]) -> float:
    began = time.monotonic()
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    return time.monotonic() - began


@pytest.mark.parametrize("name", ["clean", "simulate"])
def test_a_killed_command_leaves_the_old_file_or_the_new_one(name: str, tmp_path: Path) -> None:
    source, out = tmp_path / "source.npy", tmp_path / "out.npy"
    simulate = [*PROGRAM, *SIMULATE, "--frames", "2", "-o"]
    subprocess.run([*simulate, str(source)], check=True, capture_output=True, timeout=120)
    command = (
        [*PROGRAM, "clean", str(source), str(out), "--row-time", "20us"] if name == "clean" else [*simulate, str(out)]
    )
    duration = seconds_of(command)
    new, old = out.read_bytes(), b"old"
    moments = random.Random(1)
    for _ in range(KILLS):
        out.write_bytes(old)
        child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(duration * moments.uniform(0.3, 1.1))
        child.kill()
        child.wait()
        assert out.read_bytes() in (old, new)
