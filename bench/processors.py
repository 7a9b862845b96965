"""One thread against two on processors that are not alike, and may be threads of one core."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from ocisac_fast.chart.measuring import seconds_of


def seconds_on(processors: set[int], call: Callable[[Any], object], item: Any) -> float:
    """Seconds of a call that begins on one of these."""
    os.sched_setaffinity(0, processors)
    return seconds_of(call, item)


def gain_of_processors(workers: list[ThreadPoolExecutor]) -> float:
    """What one more processor adds to arithmetic that needs no memory: hashes by each alone over hashes by both."""
    work = functools.partial(seconds_of, hashlib.sha256, bytes(1 << 22))
    alone = [worker.submit(work).result() for worker in workers]
    together = [future.result() for future in [worker.submit(work) for worker in workers]]
    return sum(a / b for a, b in zip(alone, together, strict=True))


def in_turn_on_two(one: Callable[[Any], object], two: Callable[[Any], object], item: Any, seconds: float) -> np.ndarray:
    """(rounds, 3): seconds with one thread, with two, and what the processors gain at that time.

    One thread counts at the mean rate of both processors: on a shared host these differ, by what other guests do to
    the cores behind them; up to 1.4 was seen.
    """
    everywhere = os.sched_getaffinity(0)
    rounds: list[tuple[float, float, float]] = []
    end = time.perf_counter() + seconds
    with contextlib.ExitStack() as stack:
        workers = [
            stack.enter_context(ThreadPoolExecutor(1, initializer=os.sched_setaffinity, initargs=(0, {processor})))
            for processor in sorted(everywhere)[:2]
        ]
        while len(rounds) < 9 or time.perf_counter() < end:
            each = [seconds_on({processor}, one, item) for processor in sorted(everywhere)[:2]]
            together = seconds_on(everywhere, two, item)
            rounds.append((statistics.harmonic_mean(each), together, gain_of_processors(workers)))
    return np.array(rounds)
