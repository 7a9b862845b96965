"""Times of alternating calls, so that drift of the machine cancels."""

from __future__ import annotations

import contextlib
import importlib
import itertools
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]

POOL_BYTES = 96 << 20  # larger than caches, so that every frame comes from memory


@dataclass(frozen=True)
class Timing:
    """Medians over pairs of alternating calls, so that drift of the machine cancels."""

    seconds: float  # per call
    ratio: float  # to the reference call
    pairs: int  # of calls, or of blocks of calls
    undisturbed: float  # ratio of the tenth percentiles of both, since other load only increases times

    @classmethod
    def of(cls, mine: Sequence[float], others: Sequence[float]) -> Timing:
        """Compute from the seconds of alternating calls."""
        ratio = statistics.median(a / b for a, b in zip(mine, others, strict=True))
        fast, yardstick = (sorted(times)[len(times) // 10] for times in (mine, others))
        return cls(statistics.median(mine), ratio, len(mine), fast / yardstick)


def pool_of_frames(shape: tuple[int, int]) -> list[Bytes]:
    """Frames of noise, together larger than the caches."""
    random = np.random.default_rng(1)
    first = random.integers(40, 200, shape, dtype=np.uint8)
    return [np.roll(first, k) for k in range(max(2, -(-POOL_BYTES // first.size)))]


def in_turn(
    call: Callable[[Any], object],
    yardstick: Callable[[Any], object],
    items: Sequence[Any],
    seconds: float = 0.3,
    pairs: tuple[int, int] = (5, 80),
) -> Timing:
    """Time two alternating calls, each on the next item."""
    following = itertools.cycle(items)
    call(next(following))
    yardstick(next(following))
    times: list[float] = []
    others: list[float] = []
    end = time.perf_counter() + seconds
    while len(times) < pairs[0] or (time.perf_counter() < end and len(times) < pairs[1]):
        times.append(seconds_of(call, next(following)))
        others.append(seconds_of(yardstick, next(following)))
    return Timing.of(times, others)


def in_blocks(
    call: Callable[[Any], object],
    yardstick: Callable[[Any], object],
    items: Sequence[Any],
    seconds: float = 0.3,
    blocks: tuple[int, int] = (2, 16),
    fewest: int = 3,
) -> Timing:
    """Time two calls in alternating blocks of so many calls, each on the next item.

    Only the second half of a block counts: write-backs of the other call's cached data are complete by then. The
    default is for a call of milliseconds over a yardstick of tenths, whose blocks last about as long.
    """
    following = itertools.cycle(items)
    times: list[float] = []
    others: list[float] = []
    end = time.perf_counter() + seconds
    while len(times) < fewest or time.perf_counter() < end:
        for of, each, block in ((times, call, blocks[0]), (others, yardstick, blocks[1])):
            of.append(statistics.median([seconds_of(each, next(following)) for _ in range(block)][block // 2 :]))
    return Timing.of(times, others)


def seconds_of(call: Callable[[Any], object], item: Any) -> float:
    """Seconds of one call."""
    began = time.perf_counter()
    call(item)
    return time.perf_counter() - began


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Limit NumPy's matrix product and OpenCV to one thread, if their controls are installed."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(ModuleNotFoundError):
            stack.enter_context(importlib.import_module("threadpoolctl").threadpool_limits(1))
        with contextlib.suppress(ModuleNotFoundError):
            cv2 = importlib.import_module("cv2")
            before = cv2.getNumThreads()
            cv2.setNumThreads(1)
            stack.callback(cv2.setNumThreads, before)
        yield


def rms(values: npt.ArrayLike) -> float:
    """Root mean square; NaN if any value is."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values, dtype=np.float64)))))
