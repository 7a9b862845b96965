"""Many recordings on real schedulers and workers: equal tables, whatever is killed; one line for what is wrong."""

import contextlib
import subprocess
import sys
import time

import distributed
import pytest
from lamp_recordings import MAX_FRAMES, slowed

from ocisac_fast.batch import ClusterError, VersionError, cluster, measure_recordings, read_results
from ocisac_fast.batch.results import Results

# Connections that die with killed processes are reported by the collector of garbage.
pytestmark = pytest.mark.filterwarnings("ignore")
GAIN = ["gain", "--frequency", "500Hz", "--row-time", "22.2us", "--exposure", "1202us"]


class Processes:
    """A scheduler and its workers, each a process of its own."""

    def __init__(self, folder):
        self.environment = slowed(folder)
        self.file = folder / "scheduler.json"
        self.started = []
        self.scheduler = self.start("dask_scheduler", "--port", "0", "--no-show", "--no-dashboard")
        self.workers = []

    def start(self, module, *words):
        command = [sys.executable, "-W", "ignore", "-m", f"distributed.cli.{module}", "--scheduler-file", self.file]
        unheard = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        process = subprocess.Popen([*command, *words], env=self.environment, **unheard)
        self.started.append(process)
        return process

    def add_worker(self, *words):
        self.workers.append(self.start("dask_worker", "--nthreads", "1", "--no-nanny", "--no-dashboard", *words))

    def kill(self):
        for process in self.started:
            process.kill()
            process.wait()


@pytest.fixture
def processes(tmp_path):
    started = Processes(tmp_path)
    yield started
    started.kill()


@contextlib.contextmanager
def connected(processes, workers):
    for _ in range(workers):
        processes.add_worker()
    deadline = time.monotonic() + 60
    while not (processes.file.exists() and processes.file.read_text().rstrip().endswith("}")):  # it is written in place
        assert time.monotonic() < deadline
        time.sleep(0.05)
    with cluster(scheduler=str(processes.file)) as client:
        if workers:
            client.wait_for_workers(workers, timeout=60)
        yield client


def test_workers_and_a_scheduler_are_killed_and_each_row_is_there_once(campaign, task, truth, processes, tmp_path):
    """A scheduler and workers of their own. Three workers die, then the scheduler; the run is started again."""
    results = tmp_path / "results"
    killed = []

    def kill(progress):
        if progress.finished >= 4 * (len(killed) + 1) and len(killed) < 3:
            killed.append(processes.workers[len(killed)])
            killed[-1].kill()
            processes.add_worker()
        elif progress.finished >= 20 and len(killed) == 3:
            killed.append(processes.scheduler)
            processes.scheduler.kill()

    with connected(processes, 2) as client, pytest.raises(ClusterError, match=r"^scheduler tcp://.*: lost; what is"):
        measure_recordings(campaign.folder, task, client=client, output=results, max_frames=MAX_FRAMES, report=kill)
    assert len(killed) == 4
    processes.kill()
    finished = len(Results(results).names())
    assert 20 <= finished < campaign.count
    folder = tmp_path / "second"
    folder.mkdir()
    second = Processes(folder)
    try:
        with connected(second, 2) as client:
            done = measure_recordings(campaign.folder, task, client=client, output=results, max_frames=MAX_FRAMES)
        assert done.progress.skipped >= 18
        assert done.progress.finished == campaign.count
    finally:
        second.kill()
    assert read_results(results).equals(truth)


@pytest.mark.nightly
def test_a_recording_that_kills_every_worker_is_a_failure_and_no_more(campaign, task, processes, tmp_path, monkeypatch):
    """Also where it shares a task with others."""
    monkeypatch.setattr("ocisac_fast.batch.campaign._GROUPS_PER_THREAD", 1)
    (tmp_path / "crash.py").write_text(
        "import os\nfrom ocisac_fast.batch import jobs\n"
        "def measured(self, job, results):\n"
        "    if job.entry.path.endswith('short-05.mkv'):\n        os.kill(os.getpid(), 9)\n"
        "    return jobs.real(self, job, results)\n"
        "if not hasattr(jobs, 'real'):\n    jobs.real, jobs.Work._measured = jobs.Work._measured, measured\n"
    )
    crash = ["--preload", str(tmp_path / "crash.py")]
    with connected(processes, 0) as client:
        for _ in range(2):
            processes.start("dask_worker", "--nthreads", "1", "--nworkers", "1", "--no-dashboard", *crash)
        client.wait_for_workers(2, timeout=60)
        done = measure_recordings(campaign.folder / "night", task, client=client, output=tmp_path / "results")
    assert done.progress.finished == 35
    assert done.failures["message"].to_pylist() == ["its worker died 4 times"]
    for process in processes.started[1:]:
        process.terminate()  # nannies, which end their workers
        process.wait()


@pytest.mark.parametrize("what", ["version", "commit"])
def test_another_version_on_a_worker_is_one_line(what, campaign, processes, tmp_path, run):
    preload = {
        "version": "import importlib.metadata\nimportlib.metadata.version = lambda _: '0.0.1'\n",
        "commit": "from ocisac_fast.batch import jobs\njobs.build = lambda: {'version': '0.0.1', 'commit': 'abc'}\n",
    }
    (tmp_path / "old.py").write_text(preload[what])
    with connected(processes, 0) as client:
        processes.add_worker("--preload", str(tmp_path / "old.py"))
        client.wait_for_workers(1, timeout=60)
        words = (campaign.folder, "-o", tmp_path / "results", "--scheduler", processes.file, *GAIN)
        code, _, (line,) = run("batch", *words)
    assert code == 2
    assert line.startswith("ocisac: ocisac_fast: ")
    assert "0.0.1" in line
    assert line.endswith("allowed: the same")


def test_a_scheduler_that_is_not_there_is_one_line(campaign, tmp_path, run, monkeypatch):
    monkeypatch.setattr("ocisac_fast.batch.engines._CONNECT_SECONDS", 2)
    for scheduler in ("tcp://127.0.0.1:9", tmp_path / "none.json"):
        began = time.monotonic()
        words = (campaign.folder, "-o", tmp_path / "results", "--scheduler", scheduler, *GAIN)
        code, _, (line,) = run("batch", *words)
        assert (code, time.monotonic() - began < 20) == (2, True)
        assert line.startswith(f"ocisac: scheduler {scheduler}: not there")


def test_the_package_does_without_dask(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with cluster(workers=2) as workers:
        assert workers.count == 2
    with pytest.raises(ClusterError, match="Dask: not installed: pip install"), cluster(scheduler="tcp://127.0.0.1:9"):
        pass


def test_version_error_and_cluster_error_survive_the_way_to_the_client():
    for kind in (VersionError, ClusterError):
        error = distributed.protocol.deserialize(*distributed.protocol.serialize(kind("one line")))
        assert (type(error), str(error)) == (kind, "one line")


def test_a_result_whose_way_is_closed_is_a_lost_scheduler():
    """Before the client notices that it has no scheduler."""
    from types import SimpleNamespace

    from distributed.comm import CommClosedError

    from ocisac_fast.batch.engines import _reports

    def result(timeout):
        raise CommClosedError("reset by peer")

    client = SimpleNamespace(status="running", scheduler=SimpleNamespace(address="tcp://lamp:1"))
    with pytest.raises(ClusterError, match=r"^scheduler tcp://lamp:1: lost; what is finished is kept"):
        _reports(SimpleNamespace(result=result, status="pending"), (), client)
