"""Many recordings: two workers beside two processes of plain decoding, cost of a task, memory, model of the whole.

A scheduler and two workers, each a process of its own, measure gains of recordings of 1 s, 480 rows by 320 columns,
H.264, and of long ones of 100 s, which are cut. Recordings are links to a few files, which are in the page cache: what
is measured is processors, not disks. --check: exit code 1 where an aim is missed.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from figures import Figure, missed, print_table
from processors import TWO_CORES, arithmetic_on_two, gain_by_second

from ocisac_fast.batch import Task, cluster, measure_recordings
from ocisac_fast.batch.campaign import MAX_FRAMES, group_size
from ocisac_fast.cli.gain import frame_gains, tone_options
from ocisac_fast.files import open_recording
from ocisac_fast.files.videos import decoder_threads

ROWS, COLUMNS, RATE = 480, 320, 30
ROW_TIME, EXPOSURE, FREQUENCY = 22.2e-6, 1202e-6, 500.0
TASK = Task("gain", {"frequency": FREQUENCY, "row_time": ROW_TIME, "exposure": EXPOSURE, "waveform": "square"})
KINDS = 8  # different short recordings
LONG_SECONDS = 100
SHARE = 25  # gains by the second process are measured on one recording in so many
ROUNDS, MIN_ROUNDS, MAX_ROUNDS = 9, 3, 30  # of gains: with two cores, of these at least, of all at most
DECODINGS = 6  # of each recording in a round, so that decoding takes about as long as the batch
TINY = 300
TRIVIAL, IDLE_SECONDS = 3000, 5
GAIN_AIM, OVERHEAD_AIM, GROWTH_AIM = 0.9, 10e-3, 0.05


def write_video(path: Path, seconds: int, seed: int) -> None:
    """A lamp of 500 Hz with noise, H.264 as a camera stores it."""
    import av

    rng = np.random.default_rng(seed)
    rows = np.arange(ROWS)[:, np.newaxis]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=RATE, options={"preset": "veryfast", "crf": "23"})
        stream.height, stream.width, stream.pix_fmt = ROWS, COLUMNS, "yuv420p"
        stream.codec_context.gop_size = RATE
        noise = rng.normal(0.0, 2.0, (4, ROWS, COLUMNS))
        for index in range(seconds * RATE):
            light = 120.0 + 60.0 * np.cos(2.0 * np.pi * FREQUENCY * (ROW_TIME * rows + index / (RATE + 0.1)))
            pixels = np.clip(light + noise[index % 4], 0, 255).astype(np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="gray").reformat(format="yuv420p")))
        container.mux(stream.encode(None))


def make_campaign(folder: Path, recordings: int, long: int) -> None:
    kinds = [folder / f"kind-{k}.mkv" for k in range(KINDS)]
    for k, path in enumerate(kinds):
        write_video(path, 1, k)
    write_video(folder / "kind-long.mkv", LONG_SECONDS, KINDS)
    (folder / "all").mkdir()
    (folder / "share").mkdir()
    (folder / "tiny").mkdir()
    for k in range(recordings):
        (folder / "all" / f"{k:06d}.mkv").hardlink_to(kinds[k % KINDS])
        if k % SHARE == 0:
            (folder / "share" / f"{k:06d}.mkv").hardlink_to(kinds[k // SHARE % KINDS])
    for k in range(long):
        (folder / "all" / f"0-long-{k}.mkv").hardlink_to(folder / "kind-long.mkv")
    for k in range(TINY):
        pixels = np.random.default_rng(k).integers(0, 255, (1, 96, 8)).astype(np.uint8)
        np.save(folder / "tiny" / f"{k}.npy", pixels)


def decode(path: str) -> int:
    """Plain decoding by one thread, as a worker's: the number of frames."""
    with decoder_threads(1), open_recording(path) as stream:
        return sum(1 for _ in stream)


@contextmanager
def processes(workers: int) -> Iterator[tuple[Any, list[Any]]]:
    """A client of a scheduler and workers of their own; psutil's processes: scheduler, then workers."""
    import psutil

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scheduler.json"
        words = [sys.executable, "-W", "ignore", "-m"]
        common = ["--scheduler-file", str(file), "--no-dashboard"]
        commands = [[*words, "distributed.cli.dask_scheduler", *common, "--port", "0", "--no-show"]]
        commands += [[*words, "distributed.cli.dask_worker", *common, "--nthreads", "1", "--no-nanny"]] * workers
        started = [subprocess.Popen(each, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) for each in commands]
        try:
            while not file.exists():
                time.sleep(0.1)
            with cluster(scheduler=str(file)) as client:
                client.wait_for_workers(workers, timeout=60)
                yield client, [psutil.Process(each.pid) for each in started]
        finally:
            for each in started:
                each.kill()
                each.wait()


class Memory(threading.Thread):
    """Resident bytes of processes, twice a second."""

    def __init__(self, watched: list[Any]) -> None:
        super().__init__(daemon=True)
        self._watched, self._ended = watched, threading.Event()
        self.samples: list[list[int]] = []

    def run(self) -> None:
        while not self._ended.wait(0.5):
            self.samples.append([each.memory_info().rss for each in self._watched])

    def growth(self) -> list[float]:
        """Of the second half: the mean of its last quarter over that of its first, less 1."""
        self._ended.set()
        half = np.array(self.samples)[len(self.samples) // 2 :]
        quarter = max(len(half) // 4, 1)
        return list(half[-quarter:].mean(axis=0) / half[:quarter].mean(axis=0) - 1.0)

    @property
    def peak(self) -> list[float]:
        return list(np.array(self.samples).max(axis=0) / 2**20)


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    begin = time.perf_counter()
    value = call()
    return time.perf_counter() - begin, value


def measured(client: Any, paths: Path, results: Path) -> tuple[float, Any]:
    return timed(lambda: measure_recordings(paths, TASK, client=client, output=results).progress)


def gains_of_the_second(folder: Path) -> dict[str, float]:
    """Gains by a second process: all four in turn, in short rounds, since other work shares the machine; medians.

    Rounds count in which arithmetic finds two cores before and after: on a shared host two processors are at times
    threads of one core or busy with other work; where there are fewer than three, all count.
    """
    paths = sorted(str(path) for path in (folder / "share").iterdir())
    context = multiprocessing.get_context("spawn")
    rounds: list[dict[str, float]] = []
    with ExitStack() as opened:
        pools = {count: opened.enter_context(context.Pool(count)) for count in (1, 2)}
        clients = {count: opened.enter_context(processes(count))[0] for count in (1, 2)}
        arithmetic = opened.enter_context(arithmetic_on_two(24))

        def decoding(count: int) -> float:
            return timed(lambda: pools[count].map(decode, DECODINGS * paths, chunksize=4))[0] / DECODINGS

        def batch(count: int) -> float:
            results = folder / f"results-{len(rounds)}-{count}"
            return timed(lambda: measure_recordings(paths, TASK, client=clients[count], output=results))[0]

        for count in (1, 2):  # the first imports
            decoding(count)
            measure_recordings(paths, TASK, client=clients[count])
        while len(rounds) < MAX_ROUNDS and sum(each["cores"] > TWO_CORES for each in rounds) < ROUNDS:
            cores = gain_by_second(arithmetic.alone(), arithmetic.at_once())
            times = {"decoding_1": decoding(1), "batch_1": batch(1), "batch_2": batch(2), "decoding_2": decoding(2)}
            rounds.append(times | {"cores": min(cores, gain_by_second(arithmetic.alone(), arithmetic.at_once()))})
    quiet = [each for each in rounds if each["cores"] > TWO_CORES]
    counted = quiet if len(quiet) >= MIN_ROUNDS else rounds
    found = {name: np.array([each[name] for each in counted]) for name in rounds[0]}
    gains = {kind: found[f"{kind}_1"] / found[f"{kind}_2"] for kind in ("decoding", "batch")}
    return {
        **{name: float(np.median(values)) for name, values in found.items()},
        **{f"{kind}_gain": float(np.median(values)) for kind, values in gains.items()},
        "ratio": float(np.median(gains["batch"] / gains["decoding"])),
        "rounds": len(rounds),
        "rounds_with_two_cores": len(quiet),
    }


def spent(watched: Iterable[Any]) -> float:
    """Processor seconds of processes so far."""
    return sum(sum(each.cpu_times()[:2]) for each in watched)


def overhead(folder: Path) -> dict[str, float]:
    """What a recording costs beyond the measurement itself: tiny ones, one worker, against a plain loop.

    In seconds of the clock, and of the processors (client, scheduler and worker), which other work does not lengthen.
    """
    import psutil

    arguments, picture = TASK.arguments()
    options = tone_options(picture, **arguments)
    paths = sorted(str(path) for path in (folder / "tiny").iterdir())
    clock, processor = [], []
    with processes(1) as (client, watched):
        measure_recordings(paths[:8], TASK, client=client)
        every = [*watched, psutil.Process()]
        for number in range(3):
            begin = spent(every)
            bare, _ = timed(lambda: [frame_gains(path, picture, FREQUENCY, options) for path in paths])
            middle = spent(every)
            whole, _ = measured(client, folder / "tiny", folder / f"tiny-{number}")
            clock.append((whole - bare) / TINY)
            processor.append((spent(every) - 2 * middle + begin) / TINY)
    return {"clock": min(clock), "processor": min(processor)}


def whole_run(folder: Path, long: int) -> dict[str, Any]:
    """All recordings with two workers: time, processors' time of each part, memory."""
    import psutil

    with processes(2) as (client, watched):
        measure_recordings(str(folder / "kind-0.mkv"), TASK, client=client)
        every = [*watched, psutil.Process()]
        before = np.array([spent([each]) for each in every])
        memory = Memory(watched)
        memory.start()
        seconds, progress = measured(client, folder / "all", folder / "results")
        growth = memory.growth()
        used = np.array([spent([each]) for each in every]) - before
    return {
        "seconds": seconds,
        "recordings": progress.recordings,
        "frames": progress.frames,
        "tasks": task_count(progress.recordings, 2) + long * (LONG_SECONDS * RATE // MAX_FRAMES),
        "scheduler_cpu": used[0],
        "worker_cpu": float(used[1:3].sum()),
        "client_cpu": used[3],
        "growth": growth,
        "peak_mib": memory.peak,
    }


def processor_times(folder: Path) -> dict[str, float]:
    """Processor seconds of a short recording and of a frame of a long one, in one process and with results."""
    times = []
    for name, paths in (("short", folder / "share"), ("long", folder / "kind-long.mkv")):
        begin = time.process_time()
        progress = measure_recordings(paths, TASK, output=folder / f"processor-{name}").progress
        times.append((time.process_time() - begin) / (progress.recordings if name == "short" else progress.frames))
    return {"recording": times[0], "frame_of_long": times[1]}


def scheduler_times() -> dict[str, float]:
    """Processor seconds of the scheduler for a task, and for each second without one."""
    with processes(2) as (client, watched):
        client.gather(client.map(abs, range(100), pure=False))
        begin = spent(watched[:1])
        time.sleep(IDLE_SECONDS)
        idle = (spent(watched[:1]) - begin) / IDLE_SECONDS
        begin = spent(watched[:1])
        seconds, _ = timed(lambda: client.gather(client.map(abs, range(TRIVIAL), pure=False)))
        return {"task": (spent(watched[:1]) - begin - idle * seconds) / TRIVIAL, "idle": idle}


def task_count(recordings: int, threads: int) -> int:
    """Tasks of Dask, which hold several short recordings each."""
    return math.ceil(recordings / group_size(recordings, threads))


def model(run: dict[str, Any], scheduler: dict[str, float], workers: int) -> dict[str, float]:
    """Seconds of each resource if it were the only limit; a run takes the largest."""
    return {
        "workers": run["worker_cpu"] / workers,
        "scheduler": task_count(run["recordings"], workers) * scheduler["task"],
        "client": run["client_cpu"],
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=2000)
    parser.add_argument("--long", type=int, default=4)
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_campaign(folder, options.recordings, options.long)
        costs = overhead(folder)
        gains = gains_of_the_second(folder)
        times = processor_times(folder)
        scheduler = scheduler_times()
        run = whole_run(folder, options.long)
    frames = options.long * LONG_SECONDS * RATE
    predicted = {
        "worker_cpu": options.recordings * times["recording"] + frames * times["frame_of_long"],
        **model(run, scheduler, 2),
    }
    found = {"gains": gains, "costs": costs, "times": times, "scheduler": scheduler, "run": run, "model": predicted}
    quiet = f"{gains['rounds_with_two_cores']} of {gains['rounds']} rounds with two cores"
    name = f"gain by the second over that of decoding ({quiet})"
    figures = [
        Figure(name, gains["ratio"], limit=GAIN_AIM, at_most=False),
        Figure("overhead of a recording", 1e3 * costs["processor"], "ms", 1e3 * OVERHEAD_AIM),
        Figure("growth of memory in the second half", 100 * max(run["growth"]), "%", 100 * GROWTH_AIM),
    ]
    for part, values in found.items():
        print(part, {key: np.round(value, 5).tolist() for key, value in values.items()})
    print_table(figures)
    return int(options.check and missed(figures))


if __name__ == "__main__":
    sys.exit(main())
