"""Worker processes of this machine: each has a pipe to the process that started it, which nobody else can reach."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator
from dataclasses import dataclass
from multiprocessing.connection import Connection, Pipe, wait
from typing import Any

from ocisac_fast.batch.jobs import ClusterError, Jobs, Report, VersionError, Work
from ocisac_fast.cli import open_standard_streams
from ocisac_fast.core.results import Result

_MAX_DEATHS = 4  # of the workers of one job, which is then to blame, or of workers in a row before they started
_SECONDS_TO_END = 5.0


@dataclass(frozen=True, repr=False)
class Workers(Result):
    """Processes of this machine, which start when there is work and end with it.

    Attributes:
        count: of processes, at least 1.
    """

    count: int

    def run(self, work: Work, next_jobs: Callable[[], Jobs]) -> Generator[list[Report]]:
        """Run the jobs; reports in the order in which jobs end. A job whose workers die is a failure.

        Raises:
            ClusterError: processes do not start.
        """
        again: deque[Jobs] = deque()
        deaths: Counter[str] = Counter()
        stillborn = 0
        idle: list[_Worker] = []
        busy: dict[Any, _Worker] = {}
        try:
            while True:
                while len(busy) < self.count and (jobs := again.popleft() if again else next_jobs()):
                    worker = idle.pop() if idle else _Worker(work)
                    busy[worker.connection] = worker
                    worker.begin(jobs)
                if not busy:
                    return
                for connection in wait(list(busy)):
                    worker = busy[connection]
                    try:
                        reports = worker.answer()
                    except EOFError:
                        del busy[connection]
                        worker.end()
                        if not worker.has_started:
                            stillborn += 1
                            if stillborn == _MAX_DEATHS:
                                raise ClusterError(f"workers: {stillborn} processes ended as they started") from None
                            again.append(worker.jobs)
                            continue
                        deaths.update(job.name for job in worker.jobs)
                        lost = [job for job in worker.jobs if deaths[job.name] >= _MAX_DEATHS]
                        again.extend((job,) for job in worker.jobs if job not in lost)
                        yield [Report(job, failure=f"its worker died {_MAX_DEATHS} times") for job in lost]
                        continue
                    stillborn = 0
                    if reports is not None:
                        idle.append(busy.pop(connection))
                        yield reports
        finally:
            for worker in (*idle, *busy.values()):
                worker.process.terminate()
            for worker in (*idle, *busy.values()):
                worker.end()


class _Worker:
    """A process and its pipe."""

    def __init__(self, work: Work) -> None:
        self.jobs: Jobs = ()
        self.has_started = False
        self.connection, theirs = Pipe()
        # Its modules are those of this process: the working folder, which Python puts first, may hold anything.
        path = [str(each) for each in sys.path]
        program = f"import sys; sys.path[:] = {path!r}; from {__name__} import serve; serve({theirs.fileno()})"
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # Ctrl-C, which reaches it too, is ours
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-c", program], stdin=subprocess.PIPE, pass_fds=[theirs.fileno(), *work.locks]
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        theirs.close()
        with contextlib.suppress(OSError):  # it died: `answer` notices
            self.connection.send(work)

    def begin(self, jobs: Jobs) -> None:
        self.jobs = jobs
        with contextlib.suppress(OSError):  # it died: `answer` notices
            self.connection.send(jobs)

    def answer(self) -> list[Report] | None:
        """Reports of its jobs; None: it has started. EOFError: it died."""
        try:
            answer = self.connection.recv()
        except OSError:
            raise EOFError from None
        self.has_started = True
        if isinstance(answer, Exception):
            raise answer
        reports: list[Report] | None = answer
        return reports

    def end(self) -> None:
        """Close its pipe, at which it ends; a process that does not is killed."""
        self.connection.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(_SECONDS_TO_END)
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()  # type: ignore[union-attr]


def serve(descriptor: int) -> None:
    """Answer jobs that arrive on a connection, after the work to be done with each, until it is closed."""
    open_standard_streams()
    connection = Connection(descriptor)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # unwinding removes incomplete files
    try:
        threading.Thread(target=_end_with_parent, daemon=True).start()
    except RuntimeError as error:
        connection.send(ClusterError(f"a worker: {error}"))
        return
    with contextlib.suppress(EOFError, OSError):  # the process that started it has ended
        work: Work = connection.recv()
        connection.send(None)
        while True:
            connection.send(_answer(work, connection.recv()))


def _end_with_parent() -> None:
    """End with the process that started this one, however it ended: nothing is published after the next run began."""
    os.read(0, 1)  # nothing is ever written to this pipe
    os.kill(os.getpid(), signal.SIGTERM)


def _answer(work: Work, jobs: Jobs) -> list[Report] | Exception:
    try:
        return work(jobs)
    except (VersionError, ValueError) as error:
        return error
    except Exception as error:
        return ClusterError(f"a worker: {type(error).__name__}: {error}")
