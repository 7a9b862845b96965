"""A campaign: short recordings of a lamp as arrays and videos, a long one of each, and what is measured in them."""

import dataclasses
from pathlib import Path

import pytest
from lamp_recordings import EXPOSURE, LONG, ROW_TIME, SHORT, lamp


@dataclasses.dataclass(frozen=True)
class Campaign:
    folder: Path
    count: int
    frames: int


@pytest.fixture(scope="session")
def campaign(tmp_path_factory) -> Campaign:
    from ocisac_fast.files import write_frames

    folder = tmp_path_factory.mktemp("campaign")
    (folder / "night").mkdir()
    for k in range(36):
        write_frames(folder / "night" / f"short-{k:02d}{'.mkv' if k % 3 else '.npy'}", lamp(SHORT, k))
    write_frames(folder / "long.mkv", lamp(LONG, 100))
    write_frames(folder / "long.npy", lamp(LONG, 101))
    return Campaign(folder, 38, 36 * SHORT + 2 * LONG)


@pytest.fixture
def batch(run):
    """Runs `ocisac batch` in this process: code, lines of standard output, lines of standard error."""
    return lambda *words: run("batch", "--workers", 0, *words)


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
