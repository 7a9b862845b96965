"""Two threads on processors whose speed changes, possibly threads of one core."""

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
FULL_SPEED = 1.1  # max. time of arithmetic over the fastest of a run, where no other guest of the host slows it
FEWEST_ROUNDS = 9


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


def seconds_on_each(workers: list[ThreadPoolExecutor], work: list[Callable[[None], object]]) -> np.ndarray:
    """(2, processors) seconds of arithmetic without memory: on each processor alone, and on all at once."""
    calls = [functools.partial(worker.submit, seconds_of, own, None) for worker, own in zip(workers, work, strict=True)]
    alone = [call().result() for call in calls]
    return np.array([alone, [future.result() for future in [call() for call in calls]]])


@contextlib.contextmanager
def arithmetic_on_two() -> Iterator[Callable[[], np.ndarray]]:
    """A call of `seconds_on_each` with a thread on each of the first two processors."""
    with contextlib.ExitStack() as stack:
        workers = [
            stack.enter_context(ThreadPoolExecutor(1, initializer=os.sched_setaffinity, initargs=(0, {processor})))
            for processor in two_processors()
        ]
        work = [arithmetic() for _ in workers]
        yield lambda: seconds_on_each(workers, work)


def gain_by_second(arithmetic: np.ndarray) -> Any:
    """Times on each processor alone over those at once, added up; arithmetic: (..., 2, processors)."""
    return np.sum(arithmetic[..., 0, :] / arithmetic[..., 1, :], axis=-1)


def quiet_rounds(arithmetic: np.ndarray) -> np.ndarray:
    """(rounds,) bool: the second processor gains what a core does, and both are as fast as the run's fastest.

    arithmetic: (rounds, 2, processors) of `seconds_on_each`. The run's fastest: a twentieth of the rounds is faster.
    """
    slowest = np.max(arithmetic[:, 1], axis=1)
    at_full_speed = slowest <= FULL_SPEED * np.quantile(slowest, 0.05)
    return (gain_by_second(arithmetic) >= TWO_CORES) & at_full_speed


def rounds_on_two(pair: Callable[[], tuple[float, float]], seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """(rounds, 2) times measured by `pair`, and (rounds,) bool: `quiet_rounds` of arithmetic timed next to each.

    It takes up to twice as long if fewer than nine rounds are quiet.
    """
    times: list[tuple[float, float]] = []
    arithmetic: list[np.ndarray] = []
    start = time.perf_counter()

    def is_enough() -> bool:
        passed = time.perf_counter() - start
        if len(times) < FEWEST_ROUNDS or passed < seconds:
            return False
        return passed >= 2 * seconds or np.sum(quiet_rounds(np.array(arithmetic))) >= FEWEST_ROUNDS

    with arithmetic_on_two() as measure:
        while not is_enough():
            times.append(pair())
            arithmetic.append(measure())
    return np.array(times), quiet_rounds(np.array(arithmetic))
