"""Where jobs run: in this process, in worker processes of this machine, or on the workers of a Dask cluster."""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import importlib.metadata
import json
import logging
import os
import queue
import time
import uuid
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

from ocisac_fast.batch.jobs import ClusterError, Jobs, Report, VersionError, Work
from ocisac_fast.batch.workers import Workers

_IN_FLIGHT = 3  # groups of jobs per thread of the workers: none waits for the client, few wait in the scheduler
_CONNECT_SECONDS = 10
_RECOUNT_SECONDS = 5.0


def in_this_process(work: Work, next_jobs: Callable[[], Jobs]) -> Generator[list[Report]]:
    """Run the jobs one after another until there is none."""
    while jobs := next_jobs():
        yield work(jobs)


def on_cluster(client: Any, work: Work, next_jobs: Callable[[], Jobs]) -> Generator[list[Report]]:
    """Run the jobs on the workers of ``client``; reports in the order in which jobs end.

    A bounded number is in flight, so that scheduler and client need the same memory for any number of recordings.
    """
    _require_same_version(client)
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    running: dict[str, tuple[Any, Jobs]] = {}
    counted, limit = -_RECOUNT_SECONDS, 0
    try:
        while True:
            if time.monotonic() > counted + _RECOUNT_SECONDS:  # workers come and go
                limit = _IN_FLIGHT * max(thread_count(client), 2)
                counted = time.monotonic()
            while len(running) < limit and (jobs := next_jobs()):
                _submit(client, work, jobs, running, ended)
            if not running:
                return
            for future in _next_ended(ended, client):
                jobs = running.pop(future.key)[1]
                reports = _reports(future, jobs, client)
                if reports is None:  # it killed its workers: one of the group did
                    for job in jobs:
                        _submit(client, work, (job,), running, ended)
                else:
                    yield reports
    finally:
        if running and client.status == "running":
            with contextlib.suppress(Exception):
                client.cancel([future for future, _ in running.values()], force=True)


def _submit(
    client: Any, work: Work, jobs: Jobs, running: dict[str, tuple[Any, Jobs]], ended: queue.SimpleQueue[Any]
) -> None:
    future = client.submit(work, jobs, key=f"ocisac-{work.task.command}-{uuid.uuid4().hex}", pure=False)
    running[future.key] = future, jobs
    future.add_done_callback(ended.put)


def _next_ended(ended: queue.SimpleQueue[Any], client: Any) -> list[Any]:
    """Futures that have ended; waits for the first one.

    Raises:
        ClusterError: the scheduler was lost.
    """
    while True:
        try:
            futures = [ended.get(timeout=1.0)]
            break
        except queue.Empty:
            if client.status != "running":
                raise _lost(client) from None
    with contextlib.suppress(queue.Empty):
        while True:
            futures.append(ended.get_nowait())
    return futures


def _reports(future: Any, jobs: Jobs, client: Any) -> list[Report] | None:
    """Reports of a group of jobs; None if it killed its workers and has to be split."""
    from distributed import KilledWorker, TimeoutError as StillRunning
    from distributed.comm import CommClosedError

    try:
        while True:
            with contextlib.suppress(StillRunning):  # again, since its worker was lost with the result
                reports: list[Report] = future.result(timeout=10)
                return reports
            if client.status != "running":
                raise _lost(client)
    except (ClusterError, VersionError, ValueError):
        raise
    except KilledWorker as error:
        if len(jobs) > 1:
            return None
        return [Report(jobs[0], failure=f"its worker died {error.allowed_failures + 1} times")]
    except CommClosedError:  # of the result's way, before the client notices
        raise _lost(client) from None
    except (Exception, asyncio.CancelledError) as error:
        if client.status != "running" or future.status in ("cancelled", "lost"):
            raise _lost(client) from None
        raise ClusterError(f"a worker: {type(error).__name__}: {error}") from error


def _lost(client: Any) -> ClusterError:
    address = getattr(client.scheduler, "address", "the scheduler")
    return ClusterError(f"scheduler {address}: lost; what is finished is kept, run again to go on")


def thread_count(client: Any) -> int:
    """Threads of all workers, at least 1."""
    try:
        return max(int(sum(client.nthreads().values())), 1)
    except Exception:
        raise _lost(client) from None


def _require_same_version(client: Any) -> None:
    """Versions of all workers, by a call that works without the package too."""
    here = importlib.metadata.version("ocisac-fast")
    try:
        found = client.run(importlib.metadata.version, "ocisac-fast", on_error="return")
    except Exception:
        raise _lost(client) from None
    for worker, version in found.items():
        if version != here:
            has = "none" if isinstance(version, Exception) else version
            raise VersionError(f"ocisac_fast: worker {worker} has {has}, this process {here}; allowed: the same")


@contextlib.contextmanager
def cluster(*, scheduler: str | None = None, workers: int | None = None) -> Iterator[Any | None]:
    """A Dask client of a running scheduler, or worker processes of this machine, which listen on no port.

    Args:
        scheduler: address (``tcp://host:8786``) or scheduler file; None: this machine.
        workers: number of worker processes; None: one for each processor, if there are several; 0: none.

    Yields:
        ``distributed.Client`` or ``Workers``; None: the calling process does the work.

    Raises:
        ClusterError: no such scheduler, or Dask is not installed.
    """
    if scheduler is None:
        available = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
        count = len(available) if workers is None else workers
        yield Workers(count) if count > (1 if workers is None else 0) else None
        return
    try:
        distributed = importlib.import_module("distributed")
    except ModuleNotFoundError as error:
        raise ClusterError("Dask: not installed: pip install distributed") from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        address = scheduler
        if scheduler.endswith(".json"):
            address = json.loads(Path(scheduler).read_text(encoding="utf-8"))["address"]
        client = distributed.Client(address, timeout=_CONNECT_SECONDS)
    except (OSError, ValueError, KeyError, TypeError, TimeoutError, ImportError) as error:
        raise ClusterError(f"scheduler {scheduler}: not there ({type(error).__name__})") from error
    with client:
        yield client
