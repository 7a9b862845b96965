"""Two threads on processors whose speed changes, possibly threads of one core."""

from __future__ import annotations

import contextlib
import functools
import os
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from studies.chart.measuring import seconds_of

TWO_CORES = 1.7  # min. gain by the second processor of two cores
FULL_SPEED = 1.05  # max. time of arithmetic over the fastest of a run, where no other guest of the host slows it
FEWEST_ROUNDS = 9


def two_processors() -> list[int]:
    """The first two processors of this process, or none if they are unknown or fewer."""
    if not hasattr(os, "sched_setaffinity"):
        return []
    processors = sorted(os.sched_getaffinity(0))[:2]
    return processors if len(processors) == 2 else []


def at_mean_rate(one: Callable[[Any], object], item: Any) -> float:
    """Seconds with one thread at the mean rate of the first two processors.

    On a shared host their rates differ by the load of other guests; ratios up to 1.4 were measured.
    """
    everywhere = os.sched_getaffinity(0)
    each = []
    for processor in two_processors():
        os.sched_setaffinity(0, {processor})
        each.append(seconds_of(one, item))
    os.sched_setaffinity(0, everywhere)
    return statistics.harmonic_mean(each)


def arithmetic(products: int) -> Callable[[None], object]:
    """Products of matrices in the nearest caches, 0.06 ms each: they keep the arithmetic units of a core busy.

    A hash does not: it waits for its own last step, so two threads of one core hash twice as much as one.
    """
    factors = np.ones((products, 128, 128), np.float32)
    out = np.empty_like(factors)
    return lambda _: np.matmul(factors, factors[0], out=out)


class ArithmeticOnTwo:
    """Arithmetic without memory, timed on the first two processors.

    All times of a run are kept, since other guests may slow one of its figures throughout.
    """

    def __init__(self, workers: list[ThreadPoolExecutor], products: int) -> None:
        work = [arithmetic(products) for _ in workers]
        self._calls = [functools.partial(w.submit, seconds_of, own, None) for w, own in zip(workers, work, strict=True)]
        self._slowest_alone: list[float] = []
        self._slowest_at_once: list[float] = []

    def alone(self) -> np.ndarray:
        """(processors,) seconds, one processor after the other."""
        seconds = np.array([call().result() for call in self._calls])
        self._slowest_alone.append(np.max(seconds))
        return seconds

    def at_once(self) -> np.ndarray:
        """(processors,) seconds."""
        seconds = np.array([future.result() for future in [call() for call in self._calls]])
        self._slowest_at_once.append(np.max(seconds))
        return seconds

    def slowed(self) -> float:
        """Median time at once over the fastest twentieth's: how much other guests of the host slow it."""
        return float(np.median(self._slowest_at_once) / np.quantile(self._slowest_at_once, 0.05))

    def are_quiet(self, slowest: np.ndarray) -> np.ndarray:
        """Bools: `slowest` seconds at once are those of two cores in the fastest twentieth of the run."""
        alone, at_once = (np.quantile(times, 0.05) for times in (self._slowest_alone, self._slowest_at_once))
        return (slowest <= FULL_SPEED * at_once) & (TWO_CORES * at_once <= 2 * alone)


@contextlib.contextmanager
def arithmetic_on_two(products: int) -> Iterator[ArithmeticOnTwo]:
    """A thread on each of the first two processors for the time of a run."""
    with contextlib.ExitStack() as stack:
        workers = [
            stack.enter_context(ThreadPoolExecutor(1, initializer=os.sched_setaffinity, initargs=(0, {processor})))
            for processor in two_processors()
        ]
        yield ArithmeticOnTwo(workers, products)


def gain_by_second(alone: np.ndarray, at_once: np.ndarray) -> float:
    """Times on each processor alone over those at once, added up: 2 of two cores, 1 of two threads of one."""
    return float(np.sum(alone / at_once))


class RoundsOnTwo:
    """Rounds of calls, one after the other, each between arithmetic.

    Other guests come and go within milliseconds. The same is done before every call: helpers that slept longer before
    one of them would wake up later.
    """

    def __init__(self, calls: Sequence[Callable[[], float]], arithmetic: ArithmeticOnTwo) -> None:
        self._calls, self._arithmetic = calls, arithmetic
        self._times: list[list[float]] = []
        self._slowest: list[list[float]] = []  # before the first call and after every call

    def go_on(self, seconds: float) -> None:
        """Add rounds, one or more."""
        self._arithmetic.alone()
        before = np.max(self._arithmetic.at_once())
        end = time.perf_counter() + seconds
        while True:
            times, slowest = [], [before]
            for call in self._calls:
                times.append(call())
                slowest.append(np.max(self._arithmetic.at_once()))
            before = slowest[-1]
            self._times.append(times)
            self._slowest.append(slowest)
            if time.perf_counter() >= end:
                return

    def times(self) -> np.ndarray:
        """(rounds, calls) seconds that the calls returned."""
        return np.array(self._times)

    def quiet(self) -> np.ndarray:
        """(rounds,) bool: arithmetic before and after each call is quiet."""
        return self._arithmetic.are_quiet(np.max(self._slowest, axis=1))
