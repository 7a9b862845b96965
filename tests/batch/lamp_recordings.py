"""Recordings of a lamp for the tests of many."""

import errno
import os

import numpy as np

ROW_TIME, EXPOSURE, FREQUENCY = 22.2e-6, 1202e-6, 500.0
SHORT, LONG = 6, 90  # frames
MAX_FRAMES = 20


def lamp(frames: int, seed: int, shape: tuple[int, int] = (240, 48)) -> np.ndarray:
    """(frames, rows, columns) of a lamp of 500 Hz with noise."""
    rng = np.random.default_rng(seed)
    rows = np.arange(shape[0])
    phases = rng.uniform(0.0, 2.0 * np.pi, (frames, 1, 1))
    light = 120.0 + 60.0 * np.cos(2.0 * np.pi * FREQUENCY * ROW_TIME * rows[:, np.newaxis] + phases)
    return np.clip(light + rng.normal(0.0, 3.0, (frames, *shape)), 0, 255).astype(np.uint8)


def contents(folder):
    """Bytes of every file."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def close_folder(folder, monkeypatch):
    """Whoever runs the tests may read every folder: the system's call refuses this one."""
    listed = os.scandir

    def scandir(path="."):
        if os.fspath(path) == str(folder):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), path)
        return listed(path)

    monkeypatch.setattr(os, "scandir", scandir)


def slowed(folder):
    """Environment in which a recording takes 0.1 s more: 45 last 2 s, so the run is not over when a signal comes."""
    (folder / "sitecustomize.py").write_text(
        "import time\nfrom ocisac_fast.batch import jobs\nfast = jobs.Work._measured\n"
        "jobs.Work._measured = lambda *arguments: (time.sleep(0.1), fast(*arguments))[1]\n"
    )
    return {**os.environ, "PYTHONPATH": str(folder)}
