"""States of the results folder: what is ours is resumed or mended, what is not stays and is named."""

import contextlib
import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from lamp_recordings import ROW_TIME, SHORT, close_folder, contents, lamp

from ocisac_fast.batch import ResultsError, Task, cluster, measure_recordings, read_results, summarize
from ocisac_fast.batch.results import Results
from ocisac_fast.files import FileWarning

GAIN = Task("gain", {"frequency": "500Hz", "row_time": ROW_TIME})
OTHER = Task("gain", {"frequency": "700Hz", "row_time": ROW_TIME})
CLEANING = Task("clean", {"row_time": ROW_TIME})
WORDS = ["gain", "--frequency", "500Hz", "--row-time", str(ROW_TIME)]
COUNT = 3
NAME = f"{'0' * 16}-{'1' * 16}-all.parquet"


@pytest.fixture
def sources(tmp_path):
    (tmp_path / "r").mkdir()
    for k in range(COUNT):
        np.save(tmp_path / "r" / f"{k}.npy", lamp(SHORT, k, (96, 8)))
    return tmp_path / "r"


@pytest.fixture
def results(sources, tmp_path):
    measure_recordings(sources, GAIN, output=tmp_path / "results")
    return tmp_path / "results"


# --again


@pytest.mark.parametrize(
    "task", ['{"version": "2.0.0", "tasks": [{"label": "build"}]}', "[]", "3", "null", "", '{"command": []}', None]
)
@pytest.mark.parametrize("manifest", ['{"name": "app", "icons": []}', '{"files": {"rows/mine.txt": 7}}', None])
def test_again_removes_nothing_of_another_program_s(task, manifest, sources, tmp_path, batch):
    project = tmp_path / "p"
    files = {"task.json": task, "manifest.json": manifest, "rows/mine.txt": "thesis\n", "cleaned/2024/photo.raw": "raw"}
    for name, text in files.items():
        if text is not None:
            (project / name).parent.mkdir(parents=True, exist_ok=True)
            (project / name).write_text(text)
    before = contents(project)
    code, _, (line,) = batch(sources, "-o", project, "--again", *WORDS)
    assert (code, contents(project)) == (2, before)
    assert f"{project}: holds " in line
    assert "allowed: another folder" in line


def test_again_removes_what_the_manifest_names_with_its_length_and_names_the_rest(sources, results, batch):
    mine = results / "rows" / "mine.txt"
    mine.write_text("thesis")
    changed = next((results / "rows").rglob("*.parquet"))
    pa.parquet.write_table(pa.parquet.read_table(changed), changed, compression="none")
    (results / "task.json.bak").write_text("")
    kept = contents(results)
    np.save(sources / "new.npy", lamp(SHORT, 9, (96, 8)))
    words = ["700Hz" if word == "500Hz" else word for word in WORDS]
    code, _, err = batch(sources / "new.npy", "-o", results, "--again", *words)
    assert code == 0
    assert err == [
        f"ocisac: warning: {results}: kept, since no run wrote it: {changed.relative_to(results)}, rows/mine.txt"
    ]
    for path in (mine, changed, results / "task.json.bak"):
        assert path.read_bytes() == kept[path]
    assert len(list((results / "rows").rglob("*.parquet"))) == 2
    assert read_results(results)["frequency_hz"].unique().to_pylist() == [700.0]  # what stayed is no result


@pytest.mark.parametrize("place", ["cleaned", "rows"])
def test_again_does_not_write_over_what_no_run_wrote(sources, tmp_path, place):
    measure_recordings(sources, CLEANING, output=tmp_path / "c")
    mine = min(path for path in (tmp_path / "c" / place).rglob("*") if path.is_file())
    mine.write_text("my own notes")
    before = contents(tmp_path / "c")
    with pytest.raises(ResultsError, match=rf"c: holds {place}/.*{mine.name}, which no run wrote, where this one"):
        measure_recordings(sources, CLEANING, output=tmp_path / "c", again=True)
    assert contents(tmp_path / "c") == before
    mine.unlink()
    assert measure_recordings(sources, CLEANING, output=tmp_path / "c", again=True).progress.frames == COUNT * SHORT


@pytest.mark.parametrize("has_task", [True, False])
def test_again_knows_what_a_killed_run_wrote(has_task, sources, tmp_path):
    """Its manifest lacks the last files; or it had just removed task.json."""
    measure_recordings(sources, CLEANING, output=tmp_path / "c")
    manifest = json.loads((tmp_path / "c" / "manifest.json").read_text())
    named = {name: length for name, length in manifest["files"].items() if "/" not in name}
    (tmp_path / "c" / "manifest.json").write_text(json.dumps({"files": named}))
    (tmp_path / "c" / "cleaned" / f".{'0' * 16}.mkv").write_bytes(b"a part")  # which the next one of this name removes
    if not has_task:
        (tmp_path / "c" / "task.json").unlink()
    assert measure_recordings(sources, CLEANING, output=tmp_path / "c", again=True).progress.frames == COUNT * SHORT


def shift(results):
    shutil.move(results, results.parent / "old")


def exchange(results):
    shift(results)
    results.mkdir()


def drop_rows(results):
    shutil.rmtree(results / "rows")


def link_rows(results):
    drop_rows(results)
    (results.parent / "elsewhere").mkdir()
    (results / "rows").symlink_to(results.parent / "elsewhere")


def drop_cleaned(results):
    shutil.rmtree(results / "cleaned")


@pytest.mark.parametrize("change", [shutil.rmtree, shift, exchange, drop_rows, link_rows, drop_cleaned])
@pytest.mark.parametrize("workers", [0, 1])
def test_results_that_go_during_the_run_are_no_success(sources, tmp_path, change, workers):
    results = tmp_path / "c"

    def report(done):
        if done.finished == COUNT - 1:
            change(results)

    with cluster(workers=workers) as client, pytest.raises(ResultsError, match=r"c: .*(during the run|is a link)"):
        measure_recordings(sources, CLEANING, client=client, output=results, report=report)
    if change is exchange:
        assert not (results / "manifest.json").exists()
    elif change in (shutil.rmtree, shift):
        assert not results.exists()
    else:
        if change is link_rows:  # which the next run refuses
            assert list((tmp_path / "elsewhere").iterdir()) == []
            (results / "rows").unlink()
        done = measure_recordings(sources, CLEANING, output=results).progress
        assert done.finished == COUNT
        assert len(read_results(results)) == COUNT * SHORT


def test_a_manifest_names_nothing_outside_of_its_folder(sources, results, tmp_path):
    mine = tmp_path / "mine.txt"
    mine.write_text("thesis")
    manifest = json.loads((results / "manifest.json").read_text())
    for name in ("../mine.txt", str(mine), "rows/../../mine.txt", "rows/../mine", "cleaned/../../mine.txt"):
        manifest["files"][name] = len("thesis")
    (results / "manifest.json").write_text(json.dumps(manifest))
    measure_recordings(sources, OTHER, output=results, again=True)
    assert mine.read_text() == "thesis"


def test_another_program_s_manifest_stays(sources, tmp_path):
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "manifest.json").write_text('{"name": "app", "icons": []}')
    with pytest.raises(ResultsError, match=r"manifest\.json is not of `ocisac batch`; allowed: another folder"):
        measure_recordings(sources, GAIN, output=tmp_path / "app")
    assert (tmp_path / "app" / "manifest.json").read_text() == '{"name": "app", "icons": []}'


def test_again_in_a_new_folder_and_after_cleaning(sources, tmp_path):
    for _ in range(2):
        measure_recordings(sources, CLEANING, output=tmp_path / "c", again=True)
        assert len(list((tmp_path / "c" / "cleaned").iterdir())) == COUNT
    (sources / "0.npy").unlink()
    measure_recordings(sources, CLEANING, output=tmp_path / "c", again=True)
    assert len(list((tmp_path / "c" / "cleaned").iterdir())) == COUNT - 1


# Damage


FOREIGN = {
    "edited": lambda place: place.write_text("mine"),
    "link": lambda place: place.symlink_to(__file__),
    "pipe": os.mkfifo,
    "folder": os.mkdir,
}


@pytest.mark.parametrize("workers", [0, 1])
def test_nothing_is_written_in_a_folder_that_has_the_name_now(sources, tmp_path, workers):
    """Rows of the recordings that were being measured were."""
    results = tmp_path / "c"

    def report(done):
        if done.finished == 1 and not (tmp_path / "moved").exists():
            results.rename(tmp_path / "moved")
            results.mkdir()

    with cluster(workers=workers) as client, pytest.raises(ResultsError, match="c: moved or removed during the run"):
        measure_recordings(sources, CLEANING, client=client, output=results, report=report)
    assert list(results.iterdir()) == []


@pytest.mark.parametrize("kind", FOREIGN)
@pytest.mark.parametrize("is_changed", [False, True])
def test_a_cleaned_file_that_no_run_wrote_stays(sources, tmp_path, kind, is_changed):
    output = tmp_path / "c"
    measure_recordings(sources, CLEANING, output=output)
    victim = min((output / "cleaned").iterdir())
    victim.unlink()
    FOREIGN[kind](victim)
    there = os.lstat(victim)
    for path in sources.iterdir() if is_changed else ():
        np.save(path, lamp(SHORT + 1, 7, (96, 8)))
    for _ in range(2):
        (message,) = measure_recordings(sources, CLEANING, output=output).failures["message"].to_pylist()
        assert message.startswith(f"cleaned/{victim.name} is not as a run wrote it, and stays; allowed: ")
        assert len(read_results(output)) == 2 * (SHORT + is_changed)
        assert (os.lstat(victim).st_ino, os.lstat(victim).st_mtime_ns) == (there.st_ino, there.st_mtime_ns)
    victim.rename(tmp_path / "mine")
    for skipped in (2, COUNT):
        assert measure_recordings(sources, CLEANING, output=output).progress.skipped == skipped
    assert victim.is_file()


def test_a_cleaned_file_that_appears_meanwhile_stays(sources, tmp_path, monkeypatch):
    def written(results, name, rows, facts):
        (tmp_path / "c" / next(iter(facts["cleaned"]))).write_text("mine")
        return before(results, name, rows, facts)

    before = Results.write_rows
    monkeypatch.setattr(Results, "write_rows", written)
    done = measure_recordings(sources, CLEANING, output=tmp_path / "c")
    assert (done.progress.failed, read_results(tmp_path / "c")) == (COUNT, None)
    assert done.failures["message"][0].as_py().endswith(": appeared during this run, and is kept")
    assert {path.read_text() for path in (tmp_path / "c" / "cleaned").iterdir()} == {"mine"}


def test_a_run_that_is_killed_before_a_cleaned_file_has_its_name_is_resumed(sources, tmp_path):
    measure_recordings(sources, CLEANING, output=tmp_path / "c")
    victim, manifest = min((tmp_path / "c" / "cleaned").iterdir()), tmp_path / "c" / "manifest.json"
    victim.unlink()
    files = json.loads(manifest.read_text())["files"].items()
    manifest.write_text(json.dumps({"files": {name: size for name, size in files if victim.name[:16] not in name}}))
    for skipped in (COUNT - 1, COUNT):
        assert measure_recordings(sources, CLEANING, output=tmp_path / "c").progress.skipped == skipped
    assert victim.is_file()


@pytest.mark.parametrize("kind", ["rows/*/*.parquet", "failures/*.parquet", "task.json", "manifest.json"])
@pytest.mark.parametrize("foreign", ["link", "pipe"])
def test_no_pipe_is_waited_for_and_no_link_followed_at_the_name_of_a_result(sources, results, kind, foreign):
    (sources / "bad.npy").touch()
    measure_recordings(sources, GAIN, output=results)
    place, before = next(results.glob(kind)), Path(__file__).read_bytes()
    place.unlink()
    FOREIGN[foreign](place)
    message = f"{place.name}(, and no|, which no run wrote| is a link, a pipe or a device; allowed: another folder)"
    for again in (False, True):
        with pytest.raises(ResultsError, match=message):
            measure_recordings(sources, GAIN, output=results, again=again)
    if kind != "manifest.json":
        with pytest.raises(ResultsError, match=message):
            summarize(results)
    assert (place.is_file(), Path(__file__).read_bytes()) == (foreign == "link", before)


def test_a_full_disk_is_no_failure_of_a_recording(sources, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(np, "save", full)
    with pytest.raises(ResultsError, match="c: No space left on device"):
        measure_recordings(sources, CLEANING, output=tmp_path / "c")
    monkeypatch.undo()
    assert measure_recordings(sources, CLEANING, output=tmp_path / "c").progress.failed == 0


@pytest.mark.parametrize("damage", ["missing", "empty", "cut", "foreign"])
@pytest.mark.parametrize("kind", ["rows/*/*.parquet", "manifest.json", "failures/*.parquet"])
def test_a_damaged_file_is_named_and_the_same_command_mends_it(kind, damage, sources, results):
    (sources / "bad.npy").write_bytes(b"")
    measure_recordings(sources, GAIN, output=results)
    whole = read_results(results)
    victim = next(results.glob(kind))
    data = victim.read_bytes()
    damaged = {"missing": None, "empty": b"", "cut": data[: len(data) // 2], "foreign": b"PAR1 of another program PAR1"}
    if damage == "missing":
        victim.unlink()
    else:
        victim.write_bytes(damaged[damage])
        if kind.startswith("rows"):
            with pytest.raises(ResultsError, match=f"{victim.name}: no whole Parquet file; the same"):
                read_results(results)
    done = measure_recordings(sources, GAIN, output=results).progress
    assert (done.finished, done.failed) == (COUNT, 1)
    assert read_results(results).equals(whole)
    again = measure_recordings(sources, GAIN, output=results).progress
    assert (again.skipped, again.frames) == (COUNT, 0)


@pytest.mark.parametrize(
    ("name", "fine"),
    [("path", ["x"]), ("frames", [None, 5]), ("part", [None, []]), ("warnings", [[]]), ("cleaned", [None, {"a": "b"}])]
    + [(name, [[], None, "x", 5, {"a": "b"}]) for name in ("task", "build")],
)
def test_facts_of_other_types_are_named_and_measured_again(name, fine, sources, results):
    victim = next((results / "rows").glob("*/*"))
    whole, rows = read_results(results), pa.parquet.read_table(victim)
    facts = json.loads(rows.schema.metadata[b"ocisac"])
    for value in ([], None, "x", {"a": "b"}):
        changed = rows.replace_schema_metadata({"ocisac": json.dumps({**facts, name: value})})
        pa.parquet.write_table(changed, victim)
        is_other = name == "task" and not isinstance(value, int)
        with (
            pytest.warns(FileWarning, match=rf"{victim.name} of other options, left out; the same command")
            if is_other
            else contextlib.nullcontext()
            if value in fine
            else pytest.raises(ResultsError, match=victim.name)
        ):
            summarize(results)
        assert measure_recordings(sources, GAIN, output=results).progress.finished == COUNT
        assert read_results(results).num_rows == whole.num_rows


def test_rows_of_other_options_are_measured_again_where_no_file_says_the_options(sources, results):
    (results / "task.json").unlink()
    assert measure_recordings(sources, OTHER, output=results).progress.skipped == 0
    assert len(read_results(results)) == COUNT * SHORT


def test_rows_of_other_options_are_measured_again_where_their_file_was_edited(sources, results):
    """They were skipped, and were nobody's results."""
    task = results / "task.json"
    task.write_text(task.read_text().replace("500.0", "700.0"))
    for skipped in (0, COUNT):
        assert measure_recordings(sources, OTHER, output=results).progress.skipped == skipped
    assert read_results(results)["frequency_hz"].unique().to_pylist() == [700.0]


@pytest.mark.parametrize("change", [lambda text: None, lambda text: text.replace("500.0", "700.0"), lambda text: "x"])
def test_a_task_that_goes_or_changes_during_the_run_is_no_success(change, sources, tmp_path):
    task = tmp_path / "c" / "task.json"

    def report(done):
        if done.finished == COUNT - 1:
            text = change(task.read_text())
            task.unlink() if text is None else task.write_text(text)

    with pytest.raises(ResultsError, match=r"c: task\.json (is not of|removed or changed during the run)"):
        measure_recordings(sources, GAIN, output=task.parent, report=report)


def test_results_are_read_without_a_thread(sources, results):
    """Where none can start, as under a limit of processes, Arrow's reading of data sets never ended."""
    (sources / "bad.npy").touch()
    measure_recordings(sources, GAIN, output=results)
    program = (
        "import os, pyarrow.parquet; from ocisac_fast.batch import read_failures, read_results, summarize\n"
        "pyarrow.array([1]); count = lambda: len(os.listdir('/proc/self/task')); before = count()\n"
        f"folder = {str(results)!r}; assert read_results(folder).num_rows == {COUNT * SHORT}\n"
        "assert read_failures(folder).num_rows == len(summarize(folder).failures) == 1; assert count() == before"
    )
    subprocess.run([sys.executable, "-c", program], timeout=60, check=True)


def test_errors_of_arrow_are_one_line(results, batch, monkeypatch):
    def fail(*_, **__):
        raise pa.ArrowException("Failed to launch worker thread")

    monkeypatch.setattr(pq, "ParquetFile", fail)
    assert batch("--summary", results)[::2] == (2, ["ocisac: Failed to launch worker thread"])


def test_rows_of_another_recording_are_measured_again(sources, results):
    first, second, _ = sorted(results.glob("rows/*/*"))
    pq.write_table(pq.read_table(second), first, compression="none")  # not as long as the manifest says
    assert measure_recordings(sources, GAIN, output=results).progress.skipped == COUNT - 1
    assert len(set(read_results(results)["path"].to_pylist())) == COUNT


def test_rows_that_are_gone_are_named(results):
    victim = next((results / "rows").glob("*/*"))
    victim.unlink()
    with pytest.warns(FileWarning, match=f"{victim.name} missing; the same command measures what is missing"):
        assert len(summarize(results).recordings) == COUNT - 1


@pytest.mark.parametrize("place", ["rows", "rows/*", "failures"])
@pytest.mark.parametrize("use", ["summary", "again", "resume"])
def test_a_folder_of_results_that_cannot_be_listed_is_named(place, use, sources, results, batch, monkeypatch):
    """The run ends before it removes, counts or measures anything: its results may lie there."""
    (sources / "bad.npy").write_bytes(b"")
    measure_recordings(sources, GAIN, output=results)
    closed, before = next(results.glob(place)), contents(results)
    close_folder(closed, monkeypatch)
    words = {"summary": ["--summary", results], "again": [sources, "-o", results, "--again", *WORDS]}
    code, _, (line,) = batch(*words.get(use, [sources, "-o", results, *WORDS]))
    monkeypatch.undo()
    assert code == 2
    assert line.startswith(f"ocisac: {results}: {closed.relative_to(results)}: Permission denied")
    assert contents(results) == before


@pytest.mark.parametrize(
    "task", ["[]", "3", '"x"', '{"options": null}', '{"name": "x"}', "", '{"command": ', "[" * 9999]
)
def test_a_task_of_another_shape_is_one_line(task, sources, results, batch):
    (results / "task.json").write_text(task)
    line = f"ocisac: {results}: task.json is not of `ocisac batch`; allowed: another folder"
    for words in (["--summary", results], [sources, "-o", results, *WORDS]):
        assert batch(*words)[::2] == (2, [line])


def test_foreign_tables_in_the_rows_are_no_results(sources, results):
    whole = read_results(results)
    pa.parquet.write_table(pa.table({"x": [1]}), results / "rows" / "mine.parquet")
    (results / "rows" / "00").mkdir(exist_ok=True)
    shutil.copy(results / "rows" / "mine.parquet", results / "rows" / "00" / NAME)
    assert read_results(results).equals(whole)
    assert measure_recordings(sources, GAIN, output=results).progress.skipped == COUNT
    with pytest.warns(
        FileWarning, match=r"kept, since no run wrote it: rows/00/0+-1+-all\.parquet, rows/mine\.parquet"
    ):
        measure_recordings(sources, GAIN, output=results, again=True)


# Two runs; folders that hold each other


def test_two_runs_with_one_folder(sources, tmp_path, batch):
    """The second is refused while the first runs, and not after it was killed."""
    line = f"ocisac: {tmp_path / 'o'}: another run writes here; allowed: another folder, or its end"

    def second(_):
        assert batch(sources, "-o", tmp_path / "o", *WORDS)[::2] == (2, [line])

    measure_recordings(sources, GAIN, output=tmp_path / "o", report=second)
    program = (
        "import os; from ocisac_fast.batch import Task, measure_recordings;"
        f"measure_recordings({str(sources)!r}, Task('gain', {GAIN.options!r}), output={str(tmp_path / 'p')!r}, "
        "report=lambda done: os.kill(os.getpid(), 9) if done.finished == 2 else None)"
    )
    assert subprocess.run([sys.executable, "-c", program], timeout=60).returncode == -9
    done = measure_recordings(sources, GAIN, output=tmp_path / "p").progress
    assert (done.finished, done.skipped) == (COUNT, 2)


@pytest.mark.parametrize("output", [".", "..", "../r", "link"])
def test_a_results_folder_that_holds_the_recordings_is_refused(output, sources, tmp_path, batch, monkeypatch):
    """Nothing was measured, with exit code 0."""
    monkeypatch.chdir(sources)
    (sources / "link").symlink_to(".")
    for given in (["."], ["*.npy"], ["0.npy", "1.npy"], [str(sources)]):
        code, _, (line,) = batch(*given, "-o", output, *WORDS)
        assert code == 2
        assert "which holds the input" in line
    assert not list(sources.rglob("*.json"))


def test_results_below_a_linked_folder_are_no_recordings(sources, tmp_path):
    (tmp_path / "link").symlink_to(sources)
    for _ in range(2):
        done = measure_recordings(tmp_path / "link", GAIN, output=sources / "results").progress
        assert (done.recordings, done.failed) == (COUNT, 0)


def test_a_cleaned_file_is_that_of_its_recording_as_it_is(tmp_path, monkeypatch, batch):
    """One of an earlier state goes: also where the new one stays as it is, is damaged, or changes meanwhile."""
    folder, output = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    clean = (folder, "-o", output, "clean", "--row-time", ROW_TIME)
    even = np.full((2, 240, 48), 90, np.uint8)
    states = (lamp(2, 0), 0, 1), (even, 0, 0), (lamp(3, 1), 0, 1), (None, 3, 0), (lamp(2, 2), 0, 1)
    for frames, code, cleaned in states:
        if frames is None:
            (folder / "a.npy").write_bytes(b"garbage")
        else:
            np.save(folder / "a.npy", frames)
        assert batch(*clean)[0] == code
        assert len(list((output / "cleaned").iterdir())) == cleaned
        rows = read_results(output)
        values = [] if rows is None else rows.column("cleaned").to_pylist()
        assert {value is not None for value in values} <= {bool(cleaned)}
    np.save(folder / "a.npy", lamp(4, 3))
    states = iter("12345678")
    with monkeypatch.context() as changing:
        changing.setattr("ocisac_fast.batch.jobs.present_state", lambda _: next(states))
        assert batch(*clean)[0] == 3
    assert not list((output / "cleaned").iterdir())
    assert batch("--again", *clean)[0] == 0


@pytest.mark.parametrize("kind", ["rows", "failures", "cleaned", "rows/*"])
def test_no_link_is_followed_at_the_name_of_a_folder_of_results(kind, sources, tmp_path):
    results, other = tmp_path / "c", tmp_path / "other"
    measure_recordings(sources, CLEANING, output=results)
    (results / "failures").mkdir()
    place = next(results.glob(kind))
    place.rename(other)
    place.symlink_to(other)
    before = contents(other)
    for again in (False, True):
        with pytest.raises(ResultsError, match="is a link"):
            measure_recordings(sources, CLEANING, output=results, again=again)
    for read in (summarize, read_results):
        with pytest.raises(ResultsError, match="is a link"):
            read(results)
    assert contents(other) == before
