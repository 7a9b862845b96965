"""Names, kinds and places of recordings: each file is measured, or named as a failure; none ends the others."""

import os
import socket

import numpy as np
import pytest

pytest.importorskip("click")
pytest.importorskip("rich")
pytest.importorskip("PIL.Image")
pytest.importorskip("fsspec")
pytest.importorskip("pyarrow")

from lamp_recordings import ROW_TIME, SHORT, lamp

from ocisac_fast.batch import Task, measure_recordings, read_failures, read_results, summarize
from ocisac_fast.cli import main

GAIN = Task("gain", {"frequency": "500Hz", "row_time": ROW_TIME})


def save(path, seed=0):
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "wb") as file:
        np.save(file, lamp(SHORT, seed, (96, 8)))
    return path


def measured(*paths, **options):
    return set(measure_recordings([str(path) for path in paths], GAIN, **options).table["path"].to_pylist())


def test_a_path_that_exists_is_no_pattern(tmp_path):
    wanted, other = save(tmp_path / "a[1].npy"), save(tmp_path / "a1.npy")
    assert measured(wanted) == {str(wanted)}
    assert measured(tmp_path / "a[[]1].npy") == {str(wanted)}
    assert measured(tmp_path / "a[12].npy") == {str(other)}
    in_folder = save(tmp_path / "cam[1]" / "wanted.npy")
    save(tmp_path / "cam1" / "other.npy")
    assert measured(tmp_path / "cam[1]") == {str(in_folder)}
    assert measured(tmp_path / "cam[1]" / "*.npy") == {str(in_folder)}  # nor is a folder of a pattern
    assert measured(tmp_path / "**" / "w*.npy") == {str(in_folder)}
    wild = save(tmp_path / "*?.npy")
    assert measured(wild) == {str(wild)}


def test_names_of_any_bytes(tmp_path):
    """A name that is not UTF-8 is measured or listed as a failure like any other, in a first run and in a second."""
    names = [
        b"caf\xe9.npy",
        b"caf\xea.npy",
        b"a\nb.npy",
        b"\x1b]0;x\x07.npy",
        b"~root.npy",
        b" .npy",
        "汉".encode() * 80 + b".npy",
    ]
    sources = [save(tmp_path / "r" / os.fsdecode(name)) for name in names]
    (tmp_path / "r" / os.fsdecode(b"bad\xff.npy")).write_bytes(b"")
    results = tmp_path / "results"
    for skipped in (0, len(names)):
        done = measure_recordings(tmp_path / "r", GAIN, output=results).progress
        assert (done.finished, done.skipped, done.failed) == (len(names), skipped, 1)
    assert read_results(results).num_rows == SHORT * len(names)
    assert [one.path for one in summarize(results).recordings] == sorted(map(str, sources))
    assert read_failures(results)["path"].to_pylist() == [str(tmp_path / "r" / "bad\ufffd.npy")]
    assert main(["batch", "--summary", str(results), "--json"]) == 0
    cleaning = Task("clean", {"row_time": ROW_TIME})
    done = measure_recordings(tmp_path / "r", cleaning, output=tmp_path / "cleaned").progress
    assert (done.finished, done.failed) == (len(names), 1)


def test_pipes_sockets_and_lost_links_are_failures(tmp_path, monkeypatch):
    """None is waited for."""
    source = save(tmp_path / "r" / "a.npy")
    os.mkfifo(tmp_path / "r" / "pipe.npy")
    (tmp_path / "r" / "lost.npy").symlink_to(tmp_path / "nothing")
    (tmp_path / "r" / "device.npy").symlink_to("/dev/zero")
    (tmp_path / "r" / "link.npy").symlink_to(source)
    (tmp_path / "r" / "folder").symlink_to(tmp_path)
    with socket.socket(socket.AF_UNIX) as server:
        monkeypatch.chdir(tmp_path / "r")  # names of sockets are short
        server.bind("socket.npy")
        done = measure_recordings([tmp_path / "r", tmp_path / "r" / "pipe.npy"], GAIN)
    assert done.table["path"].unique().to_pylist() == [str(source), str(tmp_path / "r" / "link.npy")]
    failed = {os.path.basename(row["path"]): row["message"] for row in done.failures.to_pylist()}
    kind = "a pipe, device or folder, allowed: a file"
    lost = "No such file or directory"
    assert failed == {"pipe.npy": kind, "device.npy": kind, "socket.npy": kind, "lost.npy": lost}
