"""SIGKILL at any time leaves the old file or the new one, never a part of it."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from ocisac_fast.files import atomic_path

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


def test_what_a_killed_command_left_is_removed_by_the_next(tmp_path: Path) -> None:
    """Unless its process lives, which may write the same file at the same time."""
    source, out = tmp_path / "source.npy", tmp_path / "out.mkv"
    np.save(source, np.random.default_rng(0).integers(0, 255, (60, 240, 320), np.uint8))
    command = [*PROGRAM, "clean", str(source), str(out), "--row-time", "20us", "--force"]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not hidden(tmp_path):
        assert child.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.002)
    with atomic_path(out) as other:
        assert len(hidden(tmp_path)) == 2
        child.kill()
        child.wait()
        other.write_bytes(b"other")
    assert (len(hidden(tmp_path)), out.read_bytes()) == (1, b"other")
    foreign = [tmp_path / name for name in (".ab12.mkv", f".{'0' * 16}.mkv")]
    for path in foreign:
        path.write_text("mine")
    with atomic_path(out):
        assert set(hidden(tmp_path)) > set(foreign)
    assert set(hidden(tmp_path)) == set(foreign)


def hidden(folder: Path) -> list[Path]:
    return sorted(folder.glob(".*"))
