"""Files that a task reads beside each recording, as ``sense --unlit`` does, and outputs beside the results."""

import hashlib
import os
import shutil

import numpy as np
import pytest
from lamp_recordings import ROW_TIME, contents, lamp

from ocisac_fast.batch import Task, measure_recordings, read_results, recordings as found
from ocisac_fast.batch.fields import FIELDS
from ocisac_fast.batch.task import _command
from ocisac_fast.cli.outputs import InputFile, OutputFile

SENSE = ["sense", "--frequency", "500Hz", "--row-time", "22.2us", "--region", "0,0,48,240"]
GAIN = ["gain", "--frequency", "500Hz", "--row-time", "22.2us"]


@pytest.fixture
def lit(tmp_path, monkeypatch):
    """A lamp on a background, which two pictures without the lamp state: right in ``a``, wrong in ``b``."""
    rng = np.random.default_rng(0)
    monkeypatch.chdir(tmp_path)
    np.save("lit.npy", lamp(2, 0))
    for name, level in (("a", 40), ("b", 5)):
        os.mkdir(name)
        np.save(f"{name}/unlit.npy", rng.normal(level, 1, (240, 48)).astype(np.uint8))
    return tmp_path / "lit.npy"


@pytest.mark.parametrize("change", ["another folder", "another content"])
def test_another_unlit_recording_is_another_task(change, lit, tmp_path, monkeypatch, batch, facts):
    """The row of the earlier one counted as finished, with exit code 0."""
    words = (lit, "-o", tmp_path / "r", *SENSE, "--unlit", "unlit.npy")
    monkeypatch.chdir("a")
    assert batch(*words)[0] == 0
    assert batch(*words)[1][3].split() == ["skipped", "1"]
    if change == "another folder":
        monkeypatch.chdir("../b")
    else:
        shutil.copyfile("../b/unlit.npy", "unlit.npy")
    code, _, (line,) = batch(*words)
    assert (code, "r: made with unlit" in line) == (2, True)
    assert batch(*words[:3], "--again", *words[3:])[0] == 0
    (alone,) = facts(SENSE[0], lit, *SENSE[1:], "--unlit", "unlit.npy")
    ((region,),) = read_results(tmp_path / "r")["regions"].to_pylist()
    assert region["gain"] == alone["regions"][0]["gain"]


@pytest.mark.parametrize("made", [os.link, os.symlink, shutil.copyfile])
def test_no_output_replaces_what_is_read_beside_the_recordings(made, lit, tmp_path, batch):
    os.rename("a/unlit.npy", "dark.csv")
    made("dark.csv", "table.csv")
    unlit = "table.csv" if made is shutil.copyfile else "dark.csv"
    before = contents(tmp_path)
    code, _, (line,) = batch(lit, "-o", "r", "--table", "table.csv", "--force", *SENSE, "--unlit", unlit)
    assert (code, line) == (2, "ocisac: --table: got table.csv, which is read, allowed: another file")
    code, _, (line,) = batch(lit, "-o", ".", *SENSE[:1], "--row-time", "22.2us", "--unlit", unlit)
    assert (code, "which holds the input" in line) == (2, True)
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("unlit", "message"),
    [
        ("-", "--unlit: got -, allowed: a file"),
        ("", "--unlit: got no name"),
        ("pipe", "pipe: a pipe, device or folder"),
        ("/dev/zero", "/dev/zero: a pipe, device or folder"),
        ("a", "a: a pipe, device or folder"),
        ("missing.png", "missing.png: No such file"),
        ("text.png", "text.png: not a picture, a video or a .npy array"),
    ],
)
def test_what_cannot_be_read_beside_each_recording_is_refused_before_the_run(unlit, message, lit, run):
    """Pipes and standard input were waited for."""
    os.mkfifo("pipe")
    with open("text.png", "w") as file:
        file.write("no picture")
    code, out, (line,) = run("batch", lit, "-o", "r", "--workers", 1, *SENSE, "--unlit", unlit)
    assert (code, out, message in line) == (2, [], True)
    assert not os.path.exists("r")


@pytest.mark.parametrize("change", ["content", "gone"])
@pytest.mark.parametrize("workers", [0, 1])
def test_an_unlit_recording_that_changes_ends_the_run(change, workers, lit, run, monkeypatch):
    begun = measure_recordings

    def changed(*given, **options):
        if change == "gone":
            os.remove("a/unlit.npy")
        else:
            shutil.copyfile("b/unlit.npy", "a/unlit.npy")
        return begun(*given, **options)

    monkeypatch.setattr("ocisac_fast.batch.command.measure_recordings", changed)
    code, _, (line,) = run("batch", lit, "-o", "r", "--workers", workers, *SENSE, "--unlit", "a/unlit.npy")
    assert (code, "which changed meanwhile" in line) == (2, True)
    assert not list(lit.parent.rglob("*.parquet"))


@pytest.mark.parametrize("command", FIELDS)
def test_files_among_the_options_of_a_task_are_known_by_their_types(command, lit):
    known = {"frequency": "500Hz", "row_time": ROW_TIME} if command == "gain" else {}
    known |= {"frequency": "500Hz"} if command == "calibrate" else {}
    for option in _command(command).params[1 + (command == "clean") :]:
        given = {**known, str(option.name): "a/unlit.npy"}
        if isinstance(option.type, OutputFile) or option.name == "sent":
            with pytest.raises(ValueError, match=f"got option '{option.name}'"):
                Task(command, given)
        elif isinstance(option.type, InputFile):
            assert Task(command, given).inputs == [str(lit.parent / "a" / "unlit.npy")]


def test_a_file_of_a_server_without_a_mark_of_change_is_known_by_its_content(monkeypatch):
    monkeypatch.setattr("ocisac_fast.files.remote.state_of", lambda *_: None)
    fsspec = pytest.importorskip("fsspec").filesystem("memory")
    tasks = []
    for level in (1, 2, 2):
        with fsspec.open("/unlit.npy", "wb") as file:
            np.save(file, np.full((240, 48), level, np.uint8))
        tasks.append(Task("sense", {"unlit": "memory://unlit.npy"}))
    first, second, third = (task.facts() for task in tasks)
    assert (first == second, second == third) == (False, True)


def test_the_row_of_a_light_that_cannot_be_measured_is_kept(lit, batch, run):
    """The message was: Exit: 3."""
    assert run("sense", lit, *SENSE[1:], "--unlit", lit)[0] == 3
    assert batch(lit, "-o", "r", *SENSE, "--unlit", lit)[0] == 0
    ((region,),) = read_results("r")["regions"].to_pylist()
    assert "no_light" in region["flags"]


def test_outputs_among_the_results_are_refused(lit, batch):
    assert batch(lit, "-o", "r", *GAIN)[0] == 0
    (rows,) = lit.parent.glob("r/rows/*/*.parquet")
    os.symlink("r/rows", "link")
    os.mkdir("r/failures")
    os.mkdir("r/cleaned")
    before = contents(lit.parent)
    for table in (rows, "r/rows/new.parquet", "link/new.parquet", "r/failures/new.csv", "r/cleaned/new.csv"):
        for words in ((lit, "-o", "r"), ("--summary", "r")):
            code, _, (line,) = batch(*words, "--force", "--table", table, *(GAIN if words[0] == lit else ()))
            assert code == 2
            assert line.startswith(f"ocisac: --table: got {table}, which is ")
    code, _, (line,) = batch("--summary", "r", "--plot", "r/task.json", "--force")
    assert (code, line.partition(", ")[2]) == (2, "which is among the results, allowed: another folder")
    assert contents(lit.parent) == before
    assert batch("--summary", "r", "--table", "r/summary.csv", "--plot", "r/a.png")[0] == 0


@pytest.mark.parametrize("place", ["file", "memory"])
def test_the_hash_of_a_long_file_is_of_its_ends(place, tmp_path, monkeypatch):
    """A hole of terabytes, which costs its maker nothing, was read to its end."""
    system = pytest.importorskip("fsspec").filesystem(place)
    path = str(tmp_path / "a") if place == "file" else "memory://a"
    sparse = tmp_path / "sparse"
    with sparse.open("wb") as file:
        file.truncate(1 << 40)
    end = bytes(64 << 20)
    assert found.content_hash(str(sparse)) == {"sha256_of_ends": hashlib.sha256(end + end).hexdigest()}
    monkeypatch.setattr(found, "_LONG", 100)
    monkeypatch.setattr(found, "_END", 30)
    for length, key, hashed in ((100, "sha256", range(100)), (120, "sha256_of_ends", [*range(30), *range(90, 120)])):
        system.pipe_file(path, bytes(range(length)))
        assert found.content_hash(path) == {key: hashlib.sha256(bytes(hashed)).hexdigest()}


def test_a_film_without_a_frame_fails_as_alone(lit, run):
    with open("a.y4m", "wb") as file:
        file.write(b"YUV4MPEG2 W64 H64 F25:1 Ip A1:1 C420\n")
        file.truncate(20 << 20)
    code, _, (line,) = run("gain", "a.y4m", *GAIN[1:])
    assert (code, line) == (2, "ocisac: a.y4m: no frame that can be decoded")
    done = measure_recordings("a.y4m", Task("gain", {"frequency": "500Hz", "row_time": ROW_TIME}))
    assert done.failures["message"].to_pylist() == ["no frame that can be decoded"]
