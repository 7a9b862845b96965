"""The next run removes files that a killed run left beside its output; tests/batch/test_hostile.py tests the output."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from ocisac_fast.files import atomic_path

PROGRAM = [str(Path(sys.executable).with_name("ocisac"))]


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
        while len(hidden(tmp_path)) < 2:  # one that it had not locked yet was taken for what is left: it makes another
            assert child.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.002)
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


def test_what_a_second_writer_left_is_removed_too(tmp_path: Path) -> None:
    out = tmp_path / "out.mkv"
    with atomic_path(out) as first:
        first.write_bytes(b"first")
        with atomic_path(out) as second:
            second.write_bytes(b"second")
            names = hidden(tmp_path)
    for name in names:
        name.mkdir()
        (name / "new.mkv").write_bytes(b"left")
    with atomic_path(out) as third:
        third.write_bytes(b"third")
    assert (hidden(tmp_path), out.read_bytes()) == ([], b"third")
