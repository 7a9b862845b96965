"""Two threads on processors of different speed, possibly threads of one core."""

from __future__ import annotations

import contextlib
import functools
import os
import statistics
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

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


def arithmetic() -> Callable[[None], object]:
    """Products of matrices in the nearest caches: they keep the arithmetic units of a core busy.

    A hash does not: it waits for its own last step, so two threads of one core hash twice as much as one.
    """
    factors = np.ones((24, 128, 128), np.float32)
    out = np.empty_like(factors)
    return lambda _: np.matmul(factors, factors[0], out=out)


def gain_of_processors(workers: list[ThreadPoolExecutor], work: list[Callable[[None], object]]) -> float:
    """Gain by one more processor for arithmetic without memory: its time on each alone over that on both."""
    calls = [functools.partial(worker.submit, seconds_of, own, None) for worker, own in zip(workers, work, strict=True)]
    alone = [call().result() for call in calls]
    together = [future.result() for future in [call() for call in calls]]
    return sum(a / b for a, b in zip(alone, together, strict=True))


@contextlib.contextmanager
def arithmetic_on_two() -> Iterator[Callable[[], float]]:
    """A call of `gain_of_processors` with a thread on each of the first two processors."""
    with contextlib.ExitStack() as stack:
        workers = [
            stack.enter_context(ThreadPoolExecutor(1, initializer=os.sched_setaffinity, initargs=(0, {processor})))
            for processor in two_processors()
        ]
        work = [arithmetic() for _ in workers]
        yield lambda: gain_of_processors(workers, work)


def rounds_on_two(pair: Callable[[], tuple[float, float]], seconds: float) -> np.ndarray:
    """(rounds, 3): the two times measured by `pair`, and the gain of the second processor at that time.

    It takes up to eight times as long if fewer than nine rounds find two cores.
    """
    rounds: list[tuple[float, float, float]] = []
    start = time.perf_counter()
    with arithmetic_on_two() as gain:
        while len(rounds) < 9 or time.perf_counter() < start + (
            seconds if sum(of >= TWO_CORES for *_, of in rounds) >= 9 else 8 * seconds
        ):
            rounds.append((*pair(), gain()))
    return np.array(rounds)
