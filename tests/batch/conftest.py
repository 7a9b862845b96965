"""A campaign: short recordings of a lamp as arrays and videos, a long one of each, and what is measured in them."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

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


@dataclasses.dataclass(frozen=True)
class Campaign:
    folder: Path
    count: int
    frames: int


@pytest.fixture(scope="session")
def campaign(tmp_path_factory) -> Campaign:
    pytest.importorskip("pyarrow")
    pytest.importorskip("fsspec")
    pytest.importorskip("av")
    from ocisac_fast.files import write_frames

    folder = tmp_path_factory.mktemp("campaign")
    (folder / "night").mkdir()
    for k in range(36):
        write_frames(folder / "night" / f"short-{k:02d}{'.mkv' if k % 3 else '.npy'}", lamp(SHORT, k))
    write_frames(folder / "long.mkv", lamp(LONG, 100))
    write_frames(folder / "long.npy", lamp(LONG, 101))
    return Campaign(folder, 38, 36 * SHORT + 2 * LONG)


@pytest.fixture(scope="session")
def task():
    from ocisac_fast.batch import Task

    return Task("gain", {"frequency": "500Hz", "row_time": ROW_TIME, "exposure": EXPOSURE})


@pytest.fixture(scope="session")
def truth(campaign, task):
    """The table of the campaign: one recording after another, none cut."""
    from ocisac_fast.batch import measure_recordings

    done = measure_recordings(campaign.folder, task, max_frames=0)
    assert done.progress.finished == campaign.count
    assert done.table.num_rows == campaign.frames
    return done.table
