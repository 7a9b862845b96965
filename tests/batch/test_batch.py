"""Many recordings in one process: tables, stretches, resuming, failures, file systems, and what the command prints."""

import errno
import json
import os
import re

import fsspec
import numpy as np
import pyarrow as pa
import pyarrow.dataset
import pytest
from lamp_recordings import EXPOSURE, LONG, MAX_FRAMES, ROW_TIME, SHORT, lamp
from matplotlib.figure import Figure

from ocisac_fast.batch import (
    ResultsError,
    Task,
    measure_recording,
    measure_recordings,
    read_failures,
    read_results,
    summarize,
)
from ocisac_fast.batch.fields import FIELDS, columns, documentation, schema
from ocisac_fast.batch.results import Results
from ocisac_fast.files import read_frames, write_frames

GAIN = ["gain", "--frequency", "500Hz", "--row-time", "22.2us", "--exposure", "1202us"]


# The pure function


def test_the_rows_of_gain_are_its_frames_and_their_mean_is_the_command_s(campaign, task, facts):
    path = str(campaign.folder / "long.mkv")
    found = measure_recording(path, task)
    assert found["path"].unique().to_pylist() == [path]
    assert found["frame"].to_pylist() == list(range(LONG))
    (pooled,) = facts("gain", path, *GAIN[1:])
    weights = found["gain_std"].to_numpy() ** -2.0
    assert pooled["gain"] == pytest.approx(np.average(found["gain"].to_numpy(), weights=weights), rel=1e-12)
    assert set(pooled) - {"frames"} == set(found.column_names) - {"path", "frame"}


def chips_recording(facts, path):
    (sent,) = facts("transmit", "--text", "Hi", "--block-bytes", 8)
    camera = ("--row-time", "22.2us", "--exposure", "100us", "--noise", 1, "--dark-level", 16, "--columns", 16)
    light = ("--waveform", "chips", "--bits", sent["levels"], "--chip-rate", "9kHz")
    facts("simulate", *light, "--frames", 30, "--rows", 1080, *camera, "-o", path)


KNOWN = {"row_time": "22.2us"}
CASES = {
    "gain": ("gain", {"frequency": "500Hz", **KNOWN, "exposure": "1202us"}),
    "gain auto": ("gain", {"frequency": "auto"}),
    "gain in rows": ("gain", {"frequency": 0.0111}),
    "detect": ("detect", KNOWN),
    "detect in rows": ("detect", {}),
    "sense": ("sense", {**KNOWN, "frames": 3}),
    "sense in rows": ("sense", {}),
    "receive": ("receive", KNOWN),
    "receive in rows": ("receive", {}),
    "packets": ("receive", {**KNOWN, "packets": True, "chip_rate": "9kHz", "block_bytes": 8, "gain": True}),
    "tones": ("receive", {**KNOWN, "fsk": ["500Hz", "700Hz"]}),
    "calibrate": ("calibrate", {"frequency": "500Hz"}),
    "clean": ("clean", {**KNOWN, "exposure": "1202us"}),
}


@pytest.mark.filterwarnings("ignore:the tone may be no light's")  # 2.7 cycles in a frame
@pytest.mark.parametrize("name", CASES)
def test_columns_are_the_keys_of_the_command_s_json(name, campaign, tmp_path, run, facts):
    """Of every command: equal keys and values, none without a column, each column with its unit."""
    path = campaign.folder / "night" / "short-01.mkv"
    if CASES[name][0] == "receive":
        path = tmp_path / "chips.mkv"
        chips_recording(facts, path)
    if CASES[name][0] == "detect":  # stretches search each frame by itself, the command compares and follows
        write_frames(tmp_path / "frame.png", read_frames(path).frames[:1])
        path = tmp_path / "frame.png"
    task = Task(*CASES[name])
    extra = [str(tmp_path / "cleaned.mkv"), "--force"] if task.command == "clean" else []
    found = measure_recording(str(path), task, cleaned=extra[0] if extra else None)
    assert found.schema.equals(schema(columns(task.command, task.picture)))
    words = [word for option in task.options.items() for word in words_of(*option)]
    code, out, _ = run(task.command, path, *extra, *words, "--json")
    objects = [json.loads(line) for line in out]
    assert code == 0
    assert objects
    keys = {key for one in objects for key in one}
    assert keys - {"frames"} <= set(found.column_names)
    if task.command != "gain":
        rows = found.to_pylist()
        assert len(rows) == len(objects)
        for row, shown in zip(rows, objects, strict=True):
            assert {key: row[key] for key in shown} == shown
    for field in found.schema:
        assert field.metadata[b"description"]
        units = {"_hz": "Hz", "_s": "s", "_db": "dB", "_rad": "rad", "_cycles_per_row": "cycles per row"}
        for unit in [unit for suffix, unit in units.items() if field.name.endswith(suffix)][:1]:
            assert field.metadata[b"unit"].decode() == unit


def words_of(name, value):
    option = f"--{name.replace('_', '-')}"
    return [option] if value is True else [option, ",".join(value) if isinstance(value, list) else str(value)]


def test_the_reference_has_every_column():
    """`make docs` puts this text into the reference."""
    text = documentation()
    for command, fields in FIELDS.items():
        table = text.partition(f"## {command}\n")[2].partition("\n## ")[0]
        assert re.findall(r"^\| `([^`.]+)` \|", table, re.MULTILINE) == ["path", *(field.name for field in fields)]


def test_every_command_of_the_table_has_a_case():
    assert {command for command, _ in CASES.values()} == set(FIELDS)


@pytest.mark.parametrize(
    ("command", "options", "message"),
    [
        ("locate", {}, "command: got 'locate', allowed: gain, "),
        ("gain", {}, "Missing option '--frequency'"),
        ("gain", {"frequency": "fast"}, "got 'fast'"),
        ("gain", {"frequency": 500.0, "plot": "x.png"}, "got option 'plot', allowed: "),
        ("gain", {"frequency": "500Hz"}, "--frequency: Hz needs --row-time"),
        ("detect", {"exposure": "1ms"}, "--exposure: needs --row-time"),
    ],
)
def test_options_that_fit_no_recording_are_refused_at_once(command, options, message):
    with pytest.raises(ValueError, match=r"^[^\n]*$") as refused:
        Task(command, options)
    assert message in str(refused.value)


# Stretches


@pytest.mark.parametrize("max_frames", [1, 7, MAX_FRAMES])
def test_the_table_does_not_depend_on_cuts(max_frames, campaign, task, truth):
    done = measure_recordings(campaign.folder / "long*", task, max_frames=max_frames)
    wanted = truth.filter(pa.compute.starts_with(truth["path"], str(campaign.folder / "long")))
    assert done.table.equals(wanted)


@pytest.mark.parametrize(
    "options", [{"frequency": "auto", "method": "robust"}, {"frequency": 0.0111, "waveform": "square"}]
)
def test_what_is_found_beforehand_is_told_to_all_stretches(options, campaign):
    task = Task("gain", options)
    paths = campaign.folder / "long*"
    assert measure_recordings(paths, task, max_frames=15).table.equals(measure_recordings(paths, task).table)


def test_detect_in_stretches(campaign):
    task = Task("detect", KNOWN)
    whole, cut = (measure_recordings(campaign.folder / "long*", task, max_frames=n).table for n in (0, 25))
    assert whole.num_rows == 2 * LONG
    assert cut.equals(whole)


def test_a_video_whose_stretches_cannot_be_read_by_themselves_is_measured_whole(tmp_path, task):
    """Pictures refreshed in pieces, which only decoding shows: rows are those of the whole, and in no other file."""
    import av

    if "libx264" not in av.codecs_available:
        pytest.skip("FFmpeg without libx264")
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"x264-params": "intra-refresh=1"})
        stream.height, stream.width, stream.pix_fmt = 240, 48, "yuv420p"
        stream.codec_context.gop_size = 12
        for frame in lamp(LONG, 1):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="gray").reformat(format="yuv420p")))
        container.mux(stream.encode(None))
    whole = measure_recordings(tmp_path / "a.mkv", task, max_frames=0)
    done = measure_recordings(tmp_path / "a.mkv", task, max_frames=12, output=tmp_path / "results")
    assert done.progress.finished == 1
    assert whole.table.num_rows == LONG
    assert read_results(tmp_path / "results").equals(whole.table)
    assert len(Results(tmp_path / "results").names()) == 1


def test_a_truncated_video_is_measured_as_far_as_it_goes_and_says_so(tmp_path, task):
    write_frames(tmp_path / "a.mp4", lamp(LONG, 1))
    (tmp_path / "a.mp4").write_bytes((tmp_path / "a.mp4").read_bytes()[: (tmp_path / "a.mp4").stat().st_size // 2])
    whole = measure_recordings(tmp_path / "a.mp4", task, max_frames=0).table
    measure_recordings(tmp_path / "a.mp4", task, max_frames=12, output=tmp_path / "results")
    assert 0 < whole.num_rows < LONG
    assert read_results(tmp_path / "results").equals(whole)
    assert "truncated" in summarize(tmp_path / "results").recordings[0].warnings[0]


def test_a_recording_without_a_tone_is_one_row_with_its_flags(tmp_path):
    np.save(tmp_path / "dark.npy", np.full((40, 240, 48), 100, np.uint8))
    rows = measure_recordings(tmp_path, Task("gain", {"frequency": "auto"}), max_frames=10).table.to_pylist()
    assert len(rows) == 1
    assert rows[0]["frame"] is None
    assert rows[0]["gain"] is None
    assert rows[0]["flags"]


# Results: whole files, resuming, what changed


def row_files(folder):
    return {path.name: path.stat().st_mtime_ns for path in (folder / "rows").rglob("*.parquet")}


def test_results_are_a_dataset_with_facts_beside_the_rows(campaign, task, truth, tmp_path):
    results = tmp_path / "results"
    done = measure_recordings(campaign.folder, task, output=results, max_frames=MAX_FRAMES)
    assert done.table is None
    assert done.failures.num_rows == 0
    assert read_results(results).equals(truth)
    dataset = pyarrow.dataset.dataset(results / "rows", format="parquet").to_table()
    assert dataset.sort_by([("path", "ascending"), ("frame", "ascending")]).equals(truth)
    assert dataset.schema.field("frequency_hz").metadata[b"unit"] == b"Hz"
    facts, rows = next(Results(results).every_part())
    assert {"path", "size", "state", "sha256", "frames", "part", "warnings", "camera", "task", "build"} == set(facts)
    assert facts["camera"]["row_time"] == ROW_TIME
    assert facts["camera"]["exposure"] == EXPOSURE
    assert facts["task"] == task.facts()
    assert set(facts["build"]) == {"version", "commit"}
    assert rows.num_rows == facts["frames"]
    assert not [path for path in results.rglob("*") if path.name.startswith(".")]


def test_a_second_run_measures_what_is_missing_and_nothing_else(campaign, task, truth, tmp_path):
    results = tmp_path / "results"
    measure_recordings(campaign.folder, task, output=results, max_frames=MAX_FRAMES)
    before = row_files(results)
    again = measure_recordings(campaign.folder, task, output=results, max_frames=MAX_FRAMES)
    assert again.progress.skipped == campaign.count
    assert again.progress.frames == 0
    lost = [path for path in sorted((results / "rows").rglob("*.parquet")) if not path.name.endswith("all.parquet")][3]
    lost.unlink()
    more = measure_recordings(campaign.folder, task, output=results, max_frames=MAX_FRAMES)
    assert more.progress.skipped == campaign.count - 1
    assert 0 < more.progress.frames < 2 * MAX_FRAMES
    after = row_files(results)
    assert {name for name in before if after[name] != before[name]} == {lost.name}
    assert read_results(results).equals(truth)


def test_other_cuts_leave_no_row_twice(campaign, task, truth, tmp_path):
    results = tmp_path / "results"
    measure_recordings(campaign.folder, task, output=results, max_frames=MAX_FRAMES)
    stretches = [path for path in (results / "rows").rglob("*.parquet") if not path.name.endswith("all.parquet")]
    for path in stretches[::2]:
        path.unlink()
    measure_recordings(campaign.folder, task, output=results, max_frames=LONG // 2)
    assert read_results(results).equals(truth)
    for path in stretches[:1]:
        path.unlink(missing_ok=True)
    measure_recordings(campaign.folder, task, output=results, max_frames=0)
    assert read_results(results).equals(truth)


def test_a_changed_file_is_measured_anew_and_changed_options_are_refused(tmp_path, task):
    source, results = tmp_path / "a.npy", tmp_path / "results"
    np.save(source, lamp(SHORT, 1))
    measure_recordings(source, task, output=results)
    np.save(source, lamp(SHORT + 1, 2))
    assert measure_recordings(source, task, output=results).progress.frames == SHORT + 1
    assert read_results(results).equals(measure_recordings(source, task).table)
    other = Task("gain", {**task.options, "frequency": "700Hz"})
    with pytest.raises(ResultsError, match=r"frequency 500.0 instead of 700.0; allowed: .*--again"):
        measure_recordings(source, other, output=results)
    assert read_results(results)["frequency_hz"].unique().to_pylist() == [500.0]
    measure_recordings(source, other, output=results, again=True)
    assert read_results(results)["frequency_hz"].unique().to_pylist() == [700.0]


def test_another_version_of_the_package_is_noticed(tmp_path, task):
    np.save(tmp_path / "a.npy", lamp(SHORT, 1))
    measure_recordings(tmp_path / "a.npy", task, output=tmp_path / "results")
    facts = json.loads((tmp_path / "results" / "task.json").read_text())
    (tmp_path / "results" / "task.json").write_text(json.dumps({**facts, "version": "0.0.1"}))
    with pytest.raises(ResultsError, match=r"version 0\.0\.1 instead of "):
        measure_recordings(tmp_path / "a.npy", task, output=tmp_path / "results")


# Failures


def spoil(folder):
    """Nine of 180 recordings damaged, empty or gone: their names."""
    for k in range(180):
        np.save(folder / f"r{k:03d}.npy", lamp(1, k, (96, 8)))
    for k in (5, 50, 100):
        (folder / f"r{k:03d}.npy").write_bytes(b"")
        (folder / f"r{k + 1:03d}.npy").write_bytes((folder / f"r{k + 1:03d}.npy").read_bytes()[:300])
        (folder / f"r{k + 2:03d}.npy").write_bytes(os.urandom(500))


def test_one_in_twenty_spoilt_or_gone_and_all_others_complete(tmp_path, task):
    spoil(tmp_path)
    gone = tmp_path / "r150.npy"

    def remove(progress):
        gone.unlink(missing_ok=True)

    results = tmp_path / "results"
    done = measure_recordings(tmp_path / "*.npy", task, output=results, report=remove)
    names = sorted([f"r{k + n:03d}.npy" for k in (5, 50, 100) for n in range(3)] + ["r150.npy"])
    assert done.progress.finished == 170
    assert [os.path.basename(path) for path in read_failures(results)["path"].to_pylist()] == names
    assert read_failures(results).equals(done.failures)
    messages = dict(zip(names, done.failures["message"].to_pylist(), strict=True))
    assert messages["r005.npy"] == "empty file"
    assert messages["r006.npy"].startswith("truncated: ")
    assert messages["r150.npy"] == "No such file or directory"
    measured = read_results(results)["path"].unique().to_pylist()
    assert len(measured) == 170
    assert not {os.path.basename(path) for path in measured} & set(names)
    for k in (5, 6, 7):  # mended: no failure any more
        np.save(tmp_path / f"r{k:03d}.npy", lamp(1, k, (96, 8)))
    assert measure_recordings(tmp_path / "*.npy", task, output=results).progress.failed == 6
    assert read_failures(results).num_rows == 7  # the one that is gone is asked for no more


def test_whatever_a_recording_provokes_the_others_are_measured(tmp_path, task, monkeypatch):
    for k in range(3):
        np.save(tmp_path / f"{k}.npy", lamp(SHORT, k))
    from ocisac_fast.cli import gain

    real = gain.frame_gains

    def sometimes(path, *rest):
        if path.endswith("1.npy"):
            raise IndexError("a mistake\nof ours")
        return real(path, *rest)

    monkeypatch.setattr(gain, "frame_gains", sometimes)
    done = measure_recordings(tmp_path, task)
    assert done.progress.finished == 2
    assert done.failures["message"].to_pylist() == ["IndexError: a mistake of ours"]


# File systems


def test_recordings_and_results_in_memory(campaign, task, truth):
    """fsspec's in-memory file system: recordings read, results written and renamed there."""
    system = fsspec.filesystem("memory")
    for path in sorted(campaign.folder.rglob("*.*")):
        system.pipe_file(f"/bucket/{path.relative_to(campaign.folder)}", path.read_bytes())
    done = measure_recordings("memory://bucket/**/*.*", task, output="memory://out", max_frames=MAX_FRAMES)
    assert done.progress.finished == campaign.count
    again = measure_recordings("memory://bucket/**/*.*", task, output="memory://out", max_frames=MAX_FRAMES)
    assert again.progress.skipped == campaign.count
    found = read_results("memory://out")
    assert found["path"][0].as_py().startswith("memory://")
    assert found.drop_columns("path").equals(truth.drop_columns("path"))
    assert not [name for name in system.find("/out") if name.rpartition("/")[2].startswith(".")]
    cleaning = Task("clean", KNOWN)
    measure_recordings("memory://bucket/night/short-01.mkv", cleaning, output="memory://cleaned")
    row = read_results("memory://cleaned").to_pylist()[0]
    assert row["cleaned"].startswith("memory://")
    assert system.size(row["cleaned"]) > 1000
    system.rm("/bucket", recursive=True)


def test_clean_writes_files_whose_paths_are_in_the_table(campaign, tmp_path):
    results = tmp_path / "results"
    measure_recordings(campaign.folder / "night" / "short-0[01]*", Task("clean", KNOWN), output=results)

    for path in read_results(results)["cleaned"].unique().to_pylist():
        assert read_frames(path).frames.shape[:3] == (SHORT, 240, 48)
        assert os.path.dirname(path) == str(results / "cleaned")


# The results folder cannot be written


def test_a_full_disk_ends_the_run_with_one_line(campaign, tmp_path, monkeypatch, batch):
    from ocisac_fast.batch import results as module

    real = module.atomic_path

    def full(path):
        if str(path).endswith(".parquet"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return real(path)

    monkeypatch.setattr(module, "atomic_path", full)
    done = batch(campaign.folder / "long.npy", "-o", tmp_path / "results", *GAIN)
    assert done == (2, [], [f"ocisac: {tmp_path / 'results'}: No space left on device"])


def test_a_folder_that_cannot_be_written_is_one_line(campaign, tmp_path, batch):
    (tmp_path / "file").write_text("")
    done = batch(campaign.folder, "-o", tmp_path / "file" / "results", *GAIN)
    assert done == (2, [], [f"ocisac: {tmp_path / 'file' / 'results'}: Not a directory"])


# The command


def test_the_command_and_its_exit_codes(campaign, truth, tmp_path, batch):
    results = tmp_path / "results"
    code, out, err = batch(f"{campaign.folder}/**/*.*", "-o", results, "--max-frames", "20", "--json", *GAIN)
    assert (code, err) == (0, [])
    counts = {"recordings": campaign.count, "finished": campaign.count, "skipped": 0, "failed": 0}
    assert json.loads(*out) == {"output": str(results), **counts, "frames": campaign.frames}
    assert read_results(results).equals(truth)
    (tmp_path / "bad.mkv").write_bytes(b"")
    code, out, err = batch(campaign.folder, tmp_path / "bad.mkv", "-o", results, *GAIN)
    assert (code, err) == (3, [f"ocisac: failed: {tmp_path / 'bad.mkv'}: empty file"])
    assert "skipped" in " ".join(out)


@pytest.mark.parametrize("command", ["gain", "detect", "receive", "sense", "calibrate", "clean"])
def test_what_is_no_recording_is_not_read_to_its_end(command, tmp_path, monkeypatch):
    """The hash of a sparse file of terabytes took hours."""
    monkeypatch.setattr("ocisac_fast.batch.measuring.content_hash", lambda _: pytest.fail("hashed"))
    (tmp_path / "a.bin").write_bytes(bytes(1 << 20))
    options = {"frequency": "500Hz"} if command in ("gain", "calibrate") else {}
    options |= {"row_time": ROW_TIME} if command != "calibrate" else {}
    assert measure_recordings(tmp_path / "a.bin", Task(command, options), output=tmp_path / "o").progress.failed


def test_a_recording_that_is_replaced_meanwhile_is_a_failure(tmp_path, monkeypatch, batch):
    from ocisac_fast.cli import gain

    path, measured = tmp_path / "a.npy", gain.frame_gains
    np.save(path, lamp(SHORT, 0))

    def replaced(*given, **options):
        found = measured(*given, **options)
        np.save(path, lamp(SHORT + 1, 1))
        return found

    monkeypatch.setattr(gain, "frame_gains", replaced)
    code, _, err = batch(path, "-o", tmp_path / "r", *GAIN)
    assert (code, err) == (3, [f"ocisac: failed: {path}: changed while it was measured"])


def test_the_summary_prints_and_draws(campaign, tmp_path, batch, facts):
    results = tmp_path / "results"
    (tmp_path / "bad.mkv").write_bytes(b"")
    batch(campaign.folder, tmp_path / "bad.mkv", "-o", results, *GAIN)
    code, out, err = batch("--summary", results)
    assert (code, err) == (0, [])
    for shown in ("short-01.mkv", "38 with results, 1 failed", "empty file"):
        assert shown in " ".join(out)
    assert (results / "summary.png").stat().st_size > 5000
    assert batch("--summary", results)[0] == 0
    Figure().savefig(results / "summary.png")
    before = (results / "summary.png").read_bytes()
    assert (batch("--summary", results)[0], (results / "summary.png").read_bytes()) == (2, before)
    assert batch("--summary", results, "--force")[0] == 0
    assert (results / "summary.png").read_bytes() != before
    (results / "summary.png").unlink()
    (tmp_path / "mine.txt").write_text("mine")
    (results / "summary.png").symlink_to(tmp_path / "mine.txt")
    code, _, err = batch("--summary", results)
    assert (code, (tmp_path / "mine.txt").read_text()) == (2, "mine")
    assert err[-1].endswith("which is no picture of it, allowed: --plot FILE, or --force")
    objects = facts("batch", "--summary", results, "--plot", tmp_path / "other.svg")
    assert len(objects) == 39
    assert objects[-1] == {"path": str(tmp_path / "bad.mkv"), "failure": "empty file"}


def test_the_value_of_the_summary_is_that_of_the_command(campaign, task, tmp_path, facts):
    path = campaign.folder / "long.npy"
    measure_recordings(path, task, output=tmp_path / "results", max_frames=MAX_FRAMES)
    one = summarize(tmp_path / "results").recordings[0]
    (shown,) = facts("gain", path, *GAIN[1:])
    assert (one.value, one.spread, one.frames) == (shown["gain"], shown["gain_std"], shown["frames"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["a.mkv", "-o", "r"], "COMMAND: got none, allowed: gain, "),
        (["-o", "r", *GAIN], "RECORDINGS: got none, allowed: "),
        (["a.mkv", *GAIN], "--output: needed"),
        (["nothing-*.mkv", "-o", "r", *GAIN], "recordings: got nothing-*.mkv, allowed: "),
        (["a.mkv", "-o", "r", *GAIN, "b.mkv"], "gain: got b.mkv, allowed: options "),
        (["a.mkv", "-o", "r", *GAIN, "--nope"], "No such option"),
        (["a.mkv", "-o", "r", *GAIN, "--json"], "got --json, allowed: its other options (batch's stand before it)"),
        (["--summary", "nothing"], "nothing: no results of `ocisac batch`"),
    ],
)
def test_what_the_command_refuses(words, message, batch, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, (line,) = batch(*words)
    assert (code, out) == (2, [])
    assert message in line
