"""Many recordings by worker processes of this machine: equal tables, whatever is killed, and no port."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest
from lamp_recordings import MAX_FRAMES, slowed

from ocisac_fast.batch import ClusterError, cluster, measure_recordings, read_results

GAIN = ["gain", "--frequency", "500Hz", "--row-time", "22.2us", "--exposure", "1202us"]
OPTIONS = ["--max-frames", str(MAX_FRAMES)]


def patched(folder, body):
    """Environment in which workers do ``body`` before a recording, whose job is ``job``."""
    (folder / "sitecustomize.py").write_text(
        "import os\nfrom ocisac_fast.batch import jobs\nreal = jobs.Work._measured\n"
        f"def measured(self, job, results):\n    {body}\n    return real(self, job, results)\n"
        "jobs.Work._measured = measured\n"
    )
    return str(folder)


@pytest.mark.parametrize("workers", [1, 2])
def test_workers_give_the_same_table(workers, campaign, task, truth, tmp_path):
    with cluster(workers=workers) as client:
        done = measure_recordings(
            campaign.folder, task, client=client, output=tmp_path / "results", max_frames=MAX_FRAMES
        )
        assert done.progress.finished == campaign.count
        assert read_results(tmp_path / "results").equals(truth)
        if workers == 2:
            assert measure_recordings(campaign.folder, task, client=client, max_frames=MAX_FRAMES).table.equals(truth)


def test_a_run_listens_nowhere(campaign, tmp_path):
    """No port, not even of this machine alone, and no named socket: others cannot ask the workers for anything."""
    words = ["batch", str(campaign.folder), "-o", str(tmp_path / "results"), "--workers", "2", *OPTIONS, *GAIN]
    run = subprocess.Popen(
        [sys.executable, "-m", "ocisac_fast.cli", *words], stderr=subprocess.DEVNULL, env=slowed(tmp_path)
    )
    try:
        deadline = time.monotonic() + 60
        while not list((tmp_path / "results").glob("rows/*/*.parquet")):
            assert run.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.01)
        processes = [psutil.Process(run.pid), *psutil.Process(run.pid).children(recursive=True)]
        assert len([each for each in processes if "import serve" in " ".join(each.cmdline())]) == 2
        internet = [(each.pid, one) for each in processes for one in each.net_connections("inet")]
        named = [one.laddr for each in processes for one in each.net_connections("unix") if one.laddr]
        assert (internet, named) == ([], [])
    finally:
        run.send_signal(signal.SIGTERM)
        assert run.wait(timeout=20) == 143
    psutil.wait_procs(processes, timeout=10)
    assert not [each for each in processes if each.is_running()]
    assert not list((tmp_path / "results").rglob(".*"))


def test_ctrl_c_ends_the_run_in_seconds_and_keeps_what_is_finished(campaign, task, truth, tmp_path):
    """As a terminal sends it: to the process and its workers."""
    results = tmp_path / "results"
    words = ["batch", str(campaign.folder), "-o", str(results), "--workers", "2", *OPTIONS, *GAIN]
    run = subprocess.Popen(
        [sys.executable, "-m", "ocisac_fast.cli", *words],
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
        env=slowed(tmp_path),
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background jobs ignore it
    )
    deadline = time.monotonic() + 60
    while not list(results.glob("rows/*/*-all.parquet")):
        assert run.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.001)
    os.killpg(run.pid, signal.SIGINT)
    _, err = run.communicate(timeout=60)
    assert run.returncode == 130
    assert err.splitlines() == [f"ocisac: interrupted; {results} keeps what is finished, the same command goes on"]
    done = measure_recordings(campaign.folder, task, output=results, max_frames=MAX_FRAMES)
    assert done.progress.skipped + done.progress.finished > done.progress.skipped > 0
    assert read_results(results).equals(truth)


@pytest.mark.parametrize("deaths", [1, 9])
def test_a_recording_that_kills_its_workers_is_a_failure_and_no_more(deaths, campaign, task, tmp_path, monkeypatch):
    (tmp_path / "deaths").mkdir()
    body = (
        f"folder = {str(tmp_path / 'deaths')!r}; n = len(os.listdir(folder))\n"
        f"    if job.entry.path.endswith('short-05.mkv') and n < {deaths}:\n"
        "        open(f'{folder}/{n}', 'w').close(); os.kill(os.getpid(), 9)"
    )
    monkeypatch.setenv("PYTHONPATH", patched(tmp_path, body))
    with cluster(workers=2) as client:
        done = measure_recordings(campaign.folder / "night", task, client=client)
    assert done.progress.finished == (36 if deaths == 1 else 35)
    assert done.failures["message"].to_pylist() == ([] if deaths == 1 else ["its worker died 4 times"])


@pytest.mark.parametrize("deaths", [3, 99])
def test_a_worker_that_dies_before_it_starts_is_replaced(deaths, campaign, task, tmp_path, monkeypatch):
    """Unless four in a row do: there is no start to hope for."""
    (tmp_path / "deaths").mkdir()
    (tmp_path / "sitecustomize.py").write_text(
        f"import os, sys\nfolder = {str(tmp_path / 'deaths')!r}; n = len(os.listdir(folder))\n"
        f"if n < {deaths}:\n    open(f'{{folder}}/{{n}}', 'w').close(); os.kill(os.getpid(), 9)\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with cluster(workers=1) as client:
        if deaths == 3:
            assert measure_recordings(campaign.folder / "night", task, client=client).progress.finished == 36
        else:
            with pytest.raises(ClusterError, match="workers: 4 processes ended as they started"):
                measure_recordings(campaign.folder / "night", task, client=client)


def test_an_error_of_a_worker_ends_the_run(campaign, task, monkeypatch, tmp_path):
    from ocisac_fast.batch import VersionError

    monkeypatch.setenv("PYTHONPATH", patched(tmp_path, "raise jobs.VersionError('another version')"))
    with cluster(workers=2) as client, pytest.raises(VersionError, match="another version"):
        measure_recordings(campaign.folder / "night", task, client=client)


def test_a_program_needs_no_guard_and_workers_import_nothing_from_the_working_folder(campaign, tmp_path):
    program, folder = tmp_path / "program.py", tmp_path / "recordings"
    folder.mkdir()
    for name in ("socket", "multiprocessing", "contextlib", "json", "signal", "numpy", "ocisac_fast", "encodings"):
        (folder / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()\n")
    program.write_text(
        "from ocisac_fast.batch import Task, cluster, measure_recordings\n"
        "with cluster(workers=1) as client:\n"
        "    task = Task('gain', {'frequency': 0.01})\n"
        f"    done = measure_recordings({str(campaign.folder / 'night')!r}, task, client=client)\n"
        "assert done.progress.finished == 36\n"
    )
    done = subprocess.run([sys.executable, program], cwd=folder, stderr=subprocess.PIPE, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "ran").exists()


def test_the_number_of_workers():
    with cluster(workers=0) as client:
        assert client is None
    with cluster() as client:
        assert client is None if len(os.sched_getaffinity(0)) == 1 else client.count == len(os.sched_getaffinity(0))


@pytest.mark.parametrize("is_busy", [False, True])
def test_a_worker_whose_run_was_killed_publishes_nothing_beside_the_next(is_busy, campaign, tmp_path):
    """It went on, and the next run failed for ever at the file that it published. ``is_busy``: it ends later."""
    mark, results = tmp_path / "mark", tmp_path / "results"
    waits = "os.path.exists('{0}') or (signal.signal(15, {1}), open('{0}', 'w').write(str(os.getpid())), time.sleep(3))"
    body = "import signal, time; " + waits.format(mark, "signal.SIG_IGN" if is_busy else "signal.getsignal(15)")
    recording = next((campaign.folder / "night").glob("*.mkv"))
    words = ["batch", str(recording), "-o", str(results), "--workers", "1", "clean", "--row-time", "22.2us"]
    command = {"args": [sys.executable, "-m", "ocisac_fast.cli", *words]}
    environment = {**os.environ, "PYTHONPATH": patched(tmp_path, body)}
    run = subprocess.Popen(**command, env=environment, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not (mark.exists() and mark.read_text()):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    worker = psutil.Process(int(mark.read_text()))
    run.kill()
    run.wait()
    if is_busy:
        second = subprocess.run(**command, env=environment, stderr=subprocess.PIPE)
        assert (second.returncode, b"another run writes here" in second.stderr) == (2, True)
        worker.wait(20)
    left = psutil.wait_procs([worker], 2)[1]
    assert all(each.status() == psutil.STATUS_ZOMBIE for each in left)  # ended, where process 1 takes no zombies
    assert bool(list(results.glob("cleaned/*"))) == is_busy
    assert subprocess.run(**command, env=environment).returncode == 0
    assert len(list(results.glob("cleaned/*"))) == len(list(results.glob("rows/*/*"))) == 1
