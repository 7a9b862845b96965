"""Any names, states of the results folder and signals: whole files or none, one line or an answer, others untouched."""

import contextlib
import io
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
from hypothesis import given, settings, strategies as st
from lamp_recordings import ROW_TIME, SHORT, contents, lamp

from ocisac_fast.batch import Task, measure_recordings, read_results
from ocisac_fast.cli import main
from ocisac_fast.files import read_frames, write_frames

GAIN = Task("gain", {"frequency": "500Hz", "row_time": ROW_TIME})
LIGHT = ["--frequency", "500Hz", "--row-time", "22.2us"]


def ended(words):
    """Exit code of a command, whose messages are single lines without control characters."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([os.fsdecode(word) for word in words])
    lines = err.getvalue().splitlines()
    assert code in (0, 2, 3), (code, lines)
    assert len(lines) == 1 or code != 2, lines
    assert all(character.isprintable() for line in lines for character in line), lines
    return code


@contextlib.contextmanager
def folder_of(files):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for path, data in files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(data)
        yield folder


def stored(suffix, frames):
    with tempfile.TemporaryDirectory() as name:
        path = pathlib.Path(name) / f"a{suffix}"
        write_frames(path, frames)
        return path.read_bytes()


# Names

SOURCES = {
    ".npy": stored(".npy", lamp(SHORT, 0, (96, 8))),
    ".png": stored(".png", lamp(1, 0, (96, 8))[0]),
    ".mkv": stored(".mkv", lamp(SHORT, 0, (96, 8))),
}
byte_names = st.one_of(
    st.binary(min_size=1, max_size=120),
    st.text(min_size=1, max_size=40).map(lambda text: text.encode("utf-8", "surrogatepass")[:120]),
    st.text(alphabet="-*?[]{}~!$%&;:#@=,.\\'\" \n\t\x1b\rab", min_size=1, max_size=12).map(str.encode),
).map(lambda name: b"_" + name[1:] if name in (b".", b"..") else name.replace(b"/", b"_").replace(b"\0", b"_"))


def words_of(command, source, other):
    return {
        "gain": [b"gain", source, *LIGHT, "--csv", other + b".csv"],
        "plot": [b"gain", source, *LIGHT, "--plot", other + b".svg"],
        "detect": [b"detect", source, "--row-time", "22.2us", "--json"],
        "clean": [b"clean", source, other, "--row-time", "22.2us"],
        "transmit": [b"transmit", "--text", "Hi", "-o", other],
        "simulate": [b"simulate", *LIGHT, "--exposure", "1ms", "--rows", "64", "--columns", "4", "-o", other],
        "batch": [b"batch", source, "-o", b"./" + other, "--workers", "0", "gain", *LIGHT],
        "summary": [b"batch", "--summary", source],
    }[command]


@settings(max_examples=settings.default.max_examples // 2)
@given(
    st.sampled_from(["gain", "plot", "detect", "clean", "transmit", "simulate", "batch", "summary"]),
    byte_names,
    byte_names,
    st.sampled_from(sorted(SOURCES)),
    st.booleans(),
)
def test_names_of_any_bytes(command, source, other, suffix, is_named):
    """The source is read, whatever its name; it and what lies beside it stay; the output is whole or not there."""
    kind = suffix.encode() if is_named else b""
    source, other = b"./" + source + kind, other + b"2" + kind
    beside = {"beside.txt": b"mine", "rows/mine.txt": b"mine"}
    with folder_of({os.fsdecode(source): SOURCES[suffix], **beside}) as folder, contextlib.chdir(folder):
        before = contents(folder)
        code = ended(words_of(command, source, other if command == "batch" else b"./" + other))
        after = contents(folder)
        if command in ("gain", "plot", "detect", "batch"):
            assert code == 0
        if command == "batch":
            assert read_results(os.fsdecode(b"./" + other)).num_rows > 0
        assert {path: after.get(path) for path in before} == before
        if code == 2:
            assert after == before or command == "batch"
        assert not [
            path
            for path in set(after) - set(before)
            if path.name.startswith(".") and path.parent == folder and not os.fsencode(path.name).startswith(other)
        ]
        if command == "clean" and code == 0:
            assert read_frames(os.fsdecode(b"./" + other)).frames.shape[1:3] == (96, 8)


# States of the results folder

FOREIGN = b'{"name": "app", "files": {"rows/mine.txt": 4, "../r/0.npy": 896}, "options": []}'
STATES = ["as it is", "missing", "empty", "cut", "foreign", "a folder", "longer"]
RECORDINGS = {f"r/{k}.npy": stored(".npy", lamp(2, k, (96, 8))) for k in range(2)} | {"r/bad.npy": b""}
MINE = {
    "o/rows/mine.txt": b"mine",
    "o/rows/ab/other.parquet": b"mine",
    "o/cleaned/photo.raw": b"mine",
    "o/notes": b"mine",
}


def spoil(path, state):
    data = path.read_bytes()
    if state in ("missing", "a folder"):
        path.unlink()
    if state == "a folder":
        path.mkdir()
    changed = {"empty": b"", "cut": data[: len(data) // 2], "foreign": FOREIGN, "longer": data + b"more"}
    if state in changed:
        path.write_bytes(changed[state])


@settings(max_examples=settings.default.max_examples // 4)
@given(st.tuples(*[st.sampled_from(STATES)] * 4), st.booleans(), st.sampled_from(["500Hz", "700Hz"]))
def test_states_of_the_results_folder(states, again, frequency):
    """A run ends with all rows, of this task alone, or with a line; files of the user stay as they are."""
    task = Task("gain", {**GAIN.options, "frequency": frequency})
    words = ["--workers", "0", "gain", "--frequency", frequency, *LIGHT[2:]]
    with folder_of({**RECORDINGS, **MINE}) as folder:
        measure_recordings(folder / "r", GAIN, output=folder / "o")
        results = folder / "o"
        kinds = ("task.json", "manifest.json", "rows/*/*-all.parquet", "failures/*.parquet")
        for kind, state in zip(kinds, states, strict=True):
            spoil(next(results.glob(kind)), state)
        code = ended(["batch", str(folder / "r"), "-o", str(results), *["--again"] * again, *words])
        kept = contents(folder)
        assert {name: kept.get(folder / name) for name in (*RECORDINGS, *MINE)} == {**RECORDINGS, **MINE}
        if code == 3:
            whole = measure_recordings(folder / "r", task).table
            assert read_results(results).equals(whole)
        ended(["batch", "--summary", str(results), "--json"])


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.just("gain"),
    lambda one: st.lists(one, max_size=3) | st.dictionaries(st.sampled_from(["name", "options", "files", "a"]), one),
    max_leaves=6,
)
COLUMNS = st.dictionaries(
    st.sampled_from(["path", "frame", "gain", "size", "message", "\x1b"]),
    st.lists(st.none() | st.integers(-9, 9), min_size=2, max_size=2)
    | st.lists(st.none() | st.text(max_size=3), min_size=2, max_size=2)
    | st.lists(st.binary(max_size=3), min_size=2, max_size=2),
)


@settings(max_examples=settings.default.max_examples // 2)
@given(st.sampled_from(["task.json", "manifest.json", "rows/*/*-all.parquet", "failures/*.parquet"]), JSON, COLUMNS)
def test_shapes_of_the_files_of_results(kind, value, columns):
    """JSON and tables of any shape are mended or named in a line; files of the user stay."""
    with folder_of({**RECORDINGS, **MINE}) as folder:
        measure_recordings(folder / "r", GAIN, output=folder / "o")
        spoilt = next((folder / "o").glob(kind))
        if kind.endswith("json"):
            spoilt.write_text(json.dumps(value))
        else:
            pyarrow.parquet.write_table(pyarrow.table(columns), spoilt)
        ended(["batch", "--summary", str(folder / "o"), "--json"])
        ended(["batch", str(folder / "r"), "-o", str(folder / "o"), "--workers", "0", "gain", *LIGHT])
        ended(["batch", "--summary", str(folder / "o")])
        kept = contents(folder)
        assert {name: kept.get(folder / name) for name in (*RECORDINGS, *MINE)} == {**RECORDINGS, **MINE}


# Signals

PROGRAM = [str(pathlib.Path(sys.executable).with_name("ocisac"))]
COMMANDS = {
    "gain": ["gain", "a.npy", *LIGHT, "--csv", "out.csv", "--force"],
    "clean": ["clean", "a.npy", "out.mkv", "--row-time", "22.2us", "--force"],
    "simulate": ["simulate", *LIGHT, "--exposure", "1ms", "--frames", "20", "-o", "out.npy", "--force"],
    "batch": ["batch", "a.npy", "b.npy", "-o", "out", "--workers", "2", "gain", *LIGHT],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_signals_at_random_times(name, tmp_path):
    """The file that was there or the new one; nothing beside it but after SIGKILL; the same command ends the work."""
    draw = random.Random(name)
    for each in ("a.npy", "b.npy"):
        np.save(tmp_path / each, lamp(20, 0, (240, 48)))
    out = tmp_path / {"gain": "out.csv", "clean": "out.mkv"}.get(name, "out.npy")

    def start():
        return subprocess.Popen(
            [*PROGRAM, *COMMANDS[name]], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )

    began = time.monotonic()
    with start() as whole:
        assert whole.wait(timeout=60) == 0, whole.stderr.read()
    duration, new = time.monotonic() - began, out.read_bytes() if name != "batch" else b""
    for number in (signal.SIGKILL, *draw.sample([signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE], 2)):
        if name == "batch":
            shutil.rmtree(tmp_path / "out")
        else:
            out.write_bytes(b"old")
        left = set(tmp_path.rglob(".*"))  # by SIGKILL: one that is interrupted as it starts removes none
        with start() as child:
            time.sleep(duration * draw.uniform(0.2, 1.0))
            child.send_signal(number)
            child.wait(timeout=20)
            err = child.stderr.read()
        assert len(err.splitlines()) <= 1 or child.returncode < 0 or "KeyboardInterrupt" in err, err
        if name != "batch":
            whole = name == "clean" and out.read_bytes() != b"old" and len(read_frames(out).frames) == 20
            assert whole or out.read_bytes() in (b"old", new)
        if number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) and child.returncode >= 0:
            assert set(tmp_path.rglob(".*")) <= left
    with start() as last:
        assert last.wait(timeout=60) == 0
    assert not list(tmp_path.rglob(".*"))
