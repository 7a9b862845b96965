"""Two threads on processors of different speed, possibly threads of one core."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import statistics
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from studies.chart.measuring import seconds_of

TWO_CORES = 1.7  # min. gain by the second processor of two cores


def two_processors() -> list[int]:
    """The first two processors of this process, or none if they are unknown or fewer."""
    if not hasattr(os, "sched_setaffinity"):
        return []
    processors = sorted(os.sched_getaffinity(0))[:2]
    return processors if len(processors) == 2 else []


def one_and_two(one: Callable[[Any], object], two: Callable[[Any], object], item: Any) -> tuple[float, float]:
    """Seconds with one thread and with two.

    The time of one thread is at the mean rate of both processors, since on a shared host their rates differ by the load
    of other guests; ratios up to 1.4 were measured.
    """
    everywhere = os.sched_getaffinity(0)
    each = []
    for processor in two_processors():
        os.sched_setaffinity(0, {processor})
        each.append(seconds_of(one, item))
    os.sched_setaffinity(0, everywhere)
    return statistics.harmonic_mean(each), seconds_of(two, item)


def gain_of_processors(workers: list[ThreadPoolExecutor]) -> float:
    """Gain by one more processor for arithmetic without memory: time of hashes on each alone over that on both."""
    work = functools.partial(seconds_of, hashlib.sha256, bytes(1 << 22))
    alone = [worker.submit(work).result() for worker in workers]
    together = [future.result() for future in [worker.submit(work) for worker in workers]]
    return sum(a / b for a, b in zip(alone, together, strict=True))


@contextlib.contextmanager
def hashing_on_two() -> Iterator[Callable[[], float]]:
    """A call of `gain_of_processors` with a thread on each of the first two processors."""
    with contextlib.ExitStack() as stack:
        workers = [
            stack.enter_context(ThreadPoolExecutor(1, initializer=os.sched_setaffinity, initargs=(0, {processor})))
            for processor in two_processors()
        ]
        yield lambda: gain_of_processors(workers)
