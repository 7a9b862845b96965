#!/usr/bin/env python3
# ruff: noqa: E402 (threads are limited before NumPy is imported)
"""Gains at memory speed: times relative to reading the frame, to peers, and to other settings of the library.

Every figure is the median of ratios of two alternating calls, each time on other frames of a pool larger than the
caches, so that drift of the machine cancels and frames come from memory. Peers alternate in blocks, so that write-backs
of one are not charged to the other. Results are checked on the same frames before timing. Limits are the project's aims
for one thread, 1080x1920 bytes, one tone, all columns.
"""

from __future__ import annotations

import os

for _library in ("OPENBLAS", "OMP", "MKL", "NUMBA"):  # one thread; read when NumPy is imported
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

import argparse
import dataclasses
import functools
import importlib.util
import itertools
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import stored
from chip_frames import make_frame
from cleaning import deflickered, fitted_psnr
from closed_forms import CHIP_LEVELS, ClosedForms
from figures import Figure, missed, print_table
from grounds import clouds
from peers import PEERS
from processors import FEWEST_ROUNDS, RoundsOnTwo, arithmetic_on_two, at_mean_rate, two_processors

from ocisac_fast import (
    Camera,
    Chips,
    SquareWave,
    Tone,
    _core,
    equalize,
    find_frequency,
    integrate_exposure,
    reference,
    tone_gain,
    varying_tone_gain,
)
from ocisac_fast.camera.linear_light import stored_values
from ocisac_fast.cleaning import VideoCleaner
from studies.chart.measuring import POOL_BYTES, Timing, in_blocks, in_turn, seconds_of

ROWS, COLUMNS, ROW_TIME = 1080, 1920, 22.2e-6
CAMERA = Camera(ROW_TIME)
SLOW, FAST = 12, 37  # cycles in the frame: f T_r = 0.011 (500 Hz) and 0.034
FOUR = (12, 37, 61, 90)
OVER_BOUND = 1.1  # limit of a row whose bound lies above its aim, over that bound
TURN = 0.06  # seconds of a row of two threads, then the next one's
GAIN_TOLERANCE = 1e-3  # one standard error; cheaper plans weight the noise differently
SLOW_FRAMES = 2  # frames of a film under slow bands that are left until a third one shows them


def figure_of(name: str, timing: Timing, limit: float | None = None, at_most: bool = True) -> Figure:
    """Figure of a ratio of times."""
    return Figure(name, timing.ratio, "x", limit, at_most, 1e3 * timing.seconds, timing.undisturbed)


def bounded(
    name: str,
    call: Callable[[Any], object],
    yardstick: Callable[[Any], object],
    frames: Any,
    seconds: float,
    aim: float,
    parts: int = 0,
) -> Iterator[Figure]:
    """Ratio to a yardstick, with the limit of its aim or of its bound: the same call on one frame, in the cache.

    For rows of which bench/README.md shows what their arithmetic takes. Calls alternate between both places, so a row
    fails if it misses the aim and frames from memory take over a tenth longer than the bound. ``parts``: the bound
    includes the start, which no arithmetic can hide: what the same call on one of so many parts of a frame takes longer
    from memory than from the cache.
    """
    timing = in_turn(call, yardstick, frames, seconds, (9, 400))
    from_memory = in_turn(call, lambda _: call(frames[0]), frames, seconds, (9, 400))
    in_cache = from_memory.seconds / from_memory.ratio
    start = of_start(call, frames, parts, seconds) if parts else 0.0
    larger = 1.0 + start / in_cache
    bound = Figure(
        "  bound: its arithmetic alone (one frame, in cache)" + (", and its start from memory" if parts else ""),
        larger * timing.ratio / from_memory.ratio,
        "x",
        milliseconds=1e3 * (in_cache + start),
        undisturbed=larger * timing.undisturbed / from_memory.undisturbed,
    )
    yield figure_of(name, timing, max(aim, OVER_BOUND * bound.value))
    yield bound


def of_start(call: Callable[[Any], object], frames: Any, parts: int, seconds: float) -> float:
    """Seconds that a call on a part of a frame's rows takes longer from memory than from the cache."""
    whole = [rows for each in zip(*(np.array_split(frame, parts) for frame in frames), strict=True) for rows in each]
    timing = in_turn(call, lambda _: call(whole[0]), whole, seconds, (9, 4000))
    return max(timing.seconds - timing.seconds / timing.ratio, 0.0)


@functools.cache
def pool() -> np.ndarray:
    """(frames, rows, columns) bytes: two tones on bins with noise; columns are rotated from frame to frame."""
    random = np.random.default_rng(1)
    phase = random.random(COLUMNS)
    turns = np.arange(ROWS)[:, None] / ROWS
    light = 100.0 + sum(40.0 * np.cos(2 * np.pi * (k * turns + phase)) for k in (SLOW, FAST))
    frame = np.clip(np.rint(light + 2.0 * random.standard_normal(light.shape)), 0, 255).astype(np.uint8)
    count = -(-POOL_BYTES // frame.size // 8) * 8
    return np.stack([np.roll(frame, 40 * j, axis=1) for j in range(count)])


def frequency(cycles: float) -> float:
    """Frequency in Hz for a number of cycles in the frame."""
    return cycles / (ROWS * ROW_TIME)


def gains(cycles: Any, efficiency: float, threads: int = 1) -> Callable[[np.ndarray], np.ndarray]:
    """The library's estimator."""
    tones = frequency(np.asarray(cycles))
    return lambda frames: tone_gain(frames, CAMERA, tones, efficiency=efficiency, threads=threads).gain


@functools.cache
def expected(cycles: Any) -> np.ndarray:
    """Gain of the pool's first frame by the NumPy reference."""
    return np.asarray(reference.tone_gain(pool()[0], CAMERA, frequency(np.asarray(cycles))).gain)


def checked(call: Callable[[np.ndarray], np.ndarray], cycles: Any, name: str) -> Callable[[np.ndarray], np.ndarray]:
    """The call, after its gains have been checked against the reference."""
    worst = float(np.max(np.abs(call(pool()[0]) - expected(cycles))))
    if not worst < GAIN_TOLERANCE:
        raise SystemExit(f"speed.py: {name}: gain off by {worst:.2g}, allowed: {GAIN_TOLERANCE:g}; not timed")
    return call


def against_reading(seconds: float) -> Iterator[Figure]:
    """Time of the library over that of reading."""
    cases = [(SLOW, 0.99, 1.5), (FAST, 0.99, 2.5), (SLOW, 1.0, 2.0), (FAST, 1.0, 2.0), (211, 1.0, 2.0)]
    for cycles, efficiency, limit in cases:
        name = f"gain / reading, f·T_r = {cycles / ROWS:.3f}, efficiency {efficiency:g}"
        call = checked(gains(cycles, efficiency), cycles, name)
        yield from bounded(name, call, _core.read_bytes, pool(), seconds, limit, parts=10)


def against_peers(seconds: float, missing: list[str]) -> Iterator[Figure]:
    """Time of each peer over that of the library, in three settings."""
    aims = {"cv2.dft batched float32": (25, 15), "scipy.fft.rfft float32": (25, 15), "numpy.fft.rfft": (70, 50)}
    for name, (first, second) in aims.items():
        library, by_peer = PEERS[name]
        if importlib.util.find_spec(library) is None:
            missing.append(name)
            continue
        for cycles, efficiency, limit in ((SLOW, 0.99, first), (FAST, 0.99, second), (FAST, 1.0, second)):
            title = f"{name} / gain, f·T_r = {cycles / ROWS:.3f}, efficiency {efficiency:g}"
            peer = checked(functools.partial(by_peer, k=cycles), cycles, name)
            own = checked(gains(cycles, efficiency), cycles, title)
            timing = in_blocks(peer, own, pool(), seconds)
            yield figure_of(title, timing, limit, at_most=False)


def four_tones(seconds: float) -> Iterator[Figure]:
    """Time for four tones over that for one."""
    for efficiency in (1.0, 0.99):
        four = checked(gains(FOUR, efficiency), FOUR, "four tones")
        one = checked(gains(SLOW, efficiency), SLOW, "one tone")
        yield from bounded(f"four tones / one, efficiency {efficiency:g}", four, one, pool(), seconds, 2.0)


def seconds_of_next(call: Callable[[np.ndarray], object], items: Sequence[np.ndarray]) -> Callable[[], float]:
    """Seconds of the call on one item after the other."""
    order = itertools.cycle(items)
    return lambda: seconds_of(call, next(order))


@dataclasses.dataclass(frozen=True)
class TwoThreads:
    """A ratio of two calls, of which one or both have two threads.

    On a shared host the processors may be threads of one core for seconds, and other guests slow their arithmetic, but
    not the memory, by half. Rounds count if arithmetic before and after each call finds two cores at full speed; if
    that is rare, all do.
    """

    name: str
    calls: tuple[Callable[[], float], Callable[[], float]]  # seconds of the next call
    limit: float | None
    at_most: bool

    def figures(self, rounds: RoundsOnTwo) -> Iterator[Figure]:
        """The figure of the rounds that count, that of all, and the share of the first."""
        times, quiet = rounds.times(), rounds.quiet()
        counted = times[quiet] if np.sum(quiet) >= FEWEST_ROUNDS else times
        yield figure_of(self.name, Timing.of(*counted.T.tolist()), self.limit, self.at_most)
        yield figure_of("  in all rounds", Timing.of(*times.T.tolist()))
        yield Figure("  rounds on two cores at full speed", 100.0 * float(np.mean(quiet)), "%")


def two_threads_in_cache() -> TwoThreads:
    """One thread over two, limited by arithmetic."""
    small = np.broadcast_to(pool()[0], (32, ROWS, COLUMNS))
    one, two = gains(FOUR, 1.0), gains(FOUR, 1.0, threads=2)
    if not np.array_equal(one(small), two(small), equal_nan=True):
        raise SystemExit("speed.py: two threads: another result than one thread; not timed")
    alone = functools.partial(at_mean_rate, one, small) if two_processors() else seconds_of_next(one, [small])
    return TwoThreads(
        "one thread / two, four tones at 1, frames in cache", (alone, seconds_of_next(two, [small])), 1.8, False
    )


def two_threads_from_memory() -> Iterator[TwoThreads]:
    """Two threads over reading with two."""
    stacks = list(pool().reshape(-1, 8, ROWS, COLUMNS))
    read = functools.partial(_core.read_bytes, threads=2)
    if read(stacks[0]) != int(stacks[0].sum(dtype=np.uint64)):
        raise SystemExit("speed.py: reading with two threads: another sum; not timed")
    half = len(stacks) // 2  # data that one call read has left the caches before the other call reads it
    read_next = seconds_of_next(read, stacks[half:] + stacks[:half])
    for efficiency in (0.99, 1.0):
        both = gains(SLOW, efficiency, threads=2)
        if not np.array_equal(both(stacks[0]), gains(SLOW, efficiency)(stacks[0])):
            raise SystemExit("speed.py: two threads: another result than one thread; not timed")
        name = f"gain / reading, two threads each, frames from memory, efficiency {efficiency:g}"
        yield TwoThreads(name, (seconds_of_next(both, stacks), read_next), 1.3, True)
    alone = seconds_of_next(_core.read_bytes, stacks)
    yield TwoThreads("reading with one thread / two", (alone, read_next), None, False)


def beside_two_threads(groups: Sequence[Iterator[Figure]], seconds: float) -> Iterator[Figure]:
    """Figures of the groups, then those of two threads, whose rounds are spread over the whole run, row by row in turn.

    Quiet moments of a shared host are shorter than a second, and may be minutes apart.
    """
    rows = [two_threads_in_cache(), *two_threads_from_memory()]
    if not two_processors():
        yield from itertools.chain(*groups)
        for row in rows:
            first, second = (lambda _, call=call: call() for call in row.calls)
            yield figure_of(row.name, in_turn(first, second, [None], seconds, (9, 400)), row.limit, row.at_most)
        return
    with arithmetic_on_two(6) as arithmetic:
        rounds = [RoundsOnTwo(row.calls, arithmetic) for row in rows]
        for group in groups:
            yield from group
            end = time.perf_counter() + 2 * seconds * len(rows)
            while time.perf_counter() < end:
                for each in rounds:
                    each.go_on(TURN)
        for row, each in zip(rows, rounds, strict=True):
            yield from row.figures(each)
        yield Figure("arithmetic on two processors, median / fastest twentieth", arithmetic.slowed(), "x")


def what_is_stored(seconds: float) -> Iterator[Figure]:
    """Time over that of reading the stored bytes, for what cameras store."""
    tone = frequency(SLOW)
    for case in stored.CASES:
        frames = stored.pool_of(case, pool(), POOL_BYTES)
        own = case.gains(tone)
        worst = float(np.max(np.abs(own(frames[0]) - case.expected(frames[0], tone))))
        if not worst < GAIN_TOLERANCE:
            raise SystemExit(f"speed.py: {case.name}: gain off by {worst:.2g}, allowed: {GAIN_TOLERANCE:g}; not timed")
        title = f"{case.name} / reading its bytes"
        if case.bounded:
            yield from bounded(title, own, stored.read, frames, seconds, case.limit)
        else:
            yield figure_of(title, in_turn(own, stored.read, frames, seconds, (9, 400)), case.limit)


def integration(seconds: float) -> Iterator[Figure]:
    """A frame of 1080x1920 exposures, each at its own time: closed forms in NumPy, float64, over the library."""
    exposure, frame_time = 1202e-6, 1.0 / 30.0
    camera = Camera(ROW_TIME, exposure, frame_time)
    out, of_peer = (np.empty((COLUMNS, ROWS)) for _ in range(2))
    forms = ClosedForms((COLUMNS, ROWS), camera)
    cases = {
        "tone": (Tone(500.0), forms.tone),
        "square wave": (SquareWave(500.0), forms.square),
        "chips": (Chips(CHIP_LEVELS, chip_rate=8e3, repeat=True), forms.chips),
    }
    for name, (waveform, by_numpy) in cases.items():

        def own(_: Any, waveform: Any = waveform) -> None:
            integrate_exposure(waveform, camera, ROWS, frames=COLUMNS, out=out)

        own(None)
        by_numpy(of_peer)
        worst = float(np.max(np.abs(out - of_peer)))
        if not worst < 1e-9:
            raise SystemExit(f"speed.py: integration of {name}: off by {worst:.2g}, allowed: 1e-9; not timed")
        timing = in_turn(lambda _, peer=by_numpy: peer(of_peer), own, [None], 4 * seconds, (3, 100))
        yield figure_of(f"exposure integration, NumPy / library, {name}", timing, 8.0, at_most=False)


def paper_gains(seconds: float) -> Iterator[Figure]:
    """The paper's estimator over cv2.dft by hand."""
    for cycles in (SLOW, FAST):
        name = f"gain by DFT / cv2.dft batched float32, f·T_r = {cycles / ROWS:.3f}"

        def paper(frames: np.ndarray, cycles: int = cycles) -> np.ndarray:
            return tone_gain(frames, CAMERA, frequency(cycles), method="dft").gain

        own = checked(paper, cycles, name)
        if importlib.util.find_spec("cv2") is not None:
            peer = checked(functools.partial(PEERS["cv2.dft batched float32"][1], k=cycles), cycles, "cv2.dft")
            yield figure_of(name, in_blocks(own, peer, pool(), seconds, (4, 4)), 1.0)


def by_hand(forward: Any, backward: Any, gain: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """A circular inverse filter of every column: rfft, product, irfft."""
    return lambda columns: backward(forward(columns, axis=0) * gain, n=ROWS, axis=0)


def equalisation(seconds: float, missing: list[str]) -> Iterator[Figure]:
    """The equaliser over rfft, product and irfft of the same frame by hand, which rings at the ends."""
    camera = Camera(ROW_TIME, 1202e-6)
    f = np.fft.rfftfreq(ROWS)[:, None]
    h = np.sinc(f * 1202e-6 / ROW_TIME)
    gain = h / np.maximum(h**2, 1e-2) * np.exp(1j * np.pi * f * 1202e-6 / ROW_TIME)
    precise = reference.equalize(pool()[0][:, :8], camera)
    cases: list[tuple[Any, Any, float, float]] = [(np.float64, np.fft, 1.0, 1e-9)]
    if importlib.util.find_spec("scipy") is None:
        missing.append("scipy.fft, for the equaliser")
    else:
        import scipy.fft

        cases.append((np.float32, scipy.fft, 1.5, 1e-5))
    for dtype, peer, limit, tolerance in cases:
        frames = list(pool()[:8].astype(dtype))
        out = np.empty((ROWS, COLUMNS), dtype)
        hand = by_hand(peer.rfft, peer.irfft, gain.astype(np.result_type(dtype, np.complex64)))

        def own(columns: np.ndarray, out: Any = out) -> np.ndarray:
            return np.asarray(equalize(columns, camera, out=out))

        name = f"equalize {np.dtype(dtype).name}"
        worst = float(np.max(np.abs(own(frames[0])[:, :8] - precise))) / float(np.max(np.abs(precise)))
        if not worst < tolerance:
            raise SystemExit(f"speed.py: {name}: off by {worst:.2g}, allowed: {tolerance:g}; not timed")
        timing = in_turn(own, hand, frames, seconds, (9, 200))
        yield figure_of(f"{name} / {peer.__name__}: rfft, product, irfft", timing, limit)


def frequency_search(seconds: float) -> Iterator[Figure]:
    """find_frequency with its defaults, in milliseconds."""
    random = np.random.default_rng(4)
    turns = 12.3 * np.arange(ROWS)[:, None] / ROWS + random.random(COLUMNS)
    for shape, wave, limits in (("sine", np.cos(2 * np.pi * turns), (4.0, 2.0)), ("square wave", None, (8.0, 5.0))):
        light = np.sign(np.cos(2 * np.pi * (turns - turns[0] + 0.2))) if wave is None else wave
        frame = np.rint(100 + 40 * light + 2 * random.standard_normal(turns.shape)).astype(np.uint8)
        for what, columns, limit in (("frame", frame, limits[0]), ("column", frame[:, 5].copy(), limits[1])):
            found = find_frequency(columns, CAMERA)
            if not abs(found.frequency - frequency(12.3)) < 5 * found.frequency_std:
                raise SystemExit(f"speed.py: find_frequency of a {what}: {found.frequency} Hz; not timed")
            timing = in_turn(lambda _, c=columns: find_frequency(c, CAMERA), lambda _: None, [None], seconds, (5, 50))
            yield Figure(f"find_frequency, a {what} with a {shape}", 1e3 * timing.seconds, "ms", limit)


def varying_tone(seconds: float) -> Iterator[Figure]:
    """varying_tone_gain over reading, bytes."""
    call = functools.partial(varying_tone_gain, camera=CAMERA, frequency=frequency(SLOW))
    steady = tone_gain(pool()[0], CAMERA, frequency(SLOW)).gain
    if not np.max(np.abs(call(pool()[0]).gain - steady)) < 5e-3:
        raise SystemExit("speed.py: varying_tone_gain of a steady tone: another gain; not timed")
    timing = in_turn(call, _core.read_bytes, pool(), seconds, (9, 200))
    yield figure_of("varying_tone_gain / reading", timing, 20.0)


def sequences(seconds: float) -> Iterator[Figure]:
    """Maximum-likelihood detection with soft outputs: states times chips a second, on a frame of 1080 rows."""
    for exposure_chips, limit in ((7.0, None), (10.0, 1.0), (14.0, None)):
        frame = make_frame(exposure_chips, 4.0, 0.01, np.random.default_rng(5))
        wrong, counted = frame.errors(frame.detect("mlse"))
        if not wrong <= 1e-3 * counted:
            raise SystemExit(f"speed.py: mlse: {wrong} of {counted} chips wrong; not timed")
        timing = in_turn(frame.detect, lambda _: None, ["mlse"], seconds, (5, 200))
        steps = 2.0**exposure_chips * frame.chips.size
        name = f"mlse, exposure of {exposure_chips:g} chips, states times chips a second"
        yield Figure(
            name, 1e-9 * steps / timing.seconds, "G/s", limit, at_most=False, milliseconds=1e3 * timing.seconds
        )


def films(missing: list[str]) -> Iterator[Figure]:
    """Processor time of a frame of 1080x1920 bytes in three colours that is cleaned, ms: the first and the later ones
    of films under bands, and all but the first of ten seconds without a light. For those under bands the gain of PSNR
    to the scene from the third frame on, dB, and the same of FFmpeg's deflicker.
    """
    random, rows = np.random.default_rng(6), np.arange(ROWS)[:, None, None]
    texture = 90 * np.exp(0.3 * clouds(ROWS, COLUMNS, random))[..., None] * (1.0, 0.8, 0.6)
    texture[:, 600:900] *= 0.5
    camera = Camera(ROW_TIME, frame_time=1 / 30, tone_curve="srgb")
    for period, count, limit in ((90.0, 20, 50.0), (370.0, 20, 50.0), (None, 300, 15.0)):
        cleaner, took, frames, cleaned = VideoCleaner(camera), list[float](), list[np.ndarray](), list[np.ndarray]()
        for k in range(20):
            angle = 0.0 if period is None else 2 * np.pi * (rows + k / (30 * ROW_TIME)) / period
            values = stored_values(texture * (1 + 0.3 * np.sin(angle)), camera, np.dtype(np.uint8)).astype(float)
            values += random.normal(0, 1.5, values.shape)
            frames.append(np.clip(np.rint(values), 0, 255).astype(np.uint8)[None])
        for k in range(count):
            begun = time.process_time()
            done = cleaner.push(frames[k % len(frames)])
            took.append(1e3 * (time.process_time() - begun))
            if period is not None:
                cleaned.append(done.frames[0])
            if k >= SLOW_FRAMES and bool(done.unchanged[0]) != (period is None):
                raise SystemExit(f"speed.py: cleaning, {period} rows a cycle: frame {k}: {done.unchanged}; not timed")
        name = "no light" if period is None else f"{period:g} rows a cycle"
        yield Figure(f"cleaning a film, {name}, first frame", took[0], "ms", 400.0)
        yield Figure(f"cleaning a film, {name}, mean of the later frames", float(np.mean(took[1:])), "ms", limit)
        if period is None:
            continue
        truth = stored_values(texture, camera, np.dtype(np.uint8))
        before = np.mean([fitted_psnr(frame[0], truth, (0, 1)) for frame in frames[SLOW_FRAMES:]])

        def gain(pictures: list[np.ndarray], truth: np.ndarray = truth, before: Any = before) -> float:
            return float(np.mean([fitted_psnr(one, truth, (0, 1)) for one in pictures[SLOW_FRAMES:]]) - before)

        yield Figure(f"cleaning a film, {name}, gain", gain(cleaned), "dB")
        if importlib.util.find_spec("av") is None:
            missing.append("av, for FFmpeg's deflicker")
            continue
        even, seconds = deflickered([frame[0] for frame in frames])
        yield Figure(f"  FFmpeg's deflicker, {name}, mean of the frames", 1e3 * seconds, "ms")
        yield Figure(f"  FFmpeg's deflicker, {name}, gain", gain(even), "dB")


def measure(seconds: float, missing: list[str]) -> Iterator[Figure]:
    """All figures."""
    groups = [
        against_reading(seconds),
        against_peers(seconds, missing),
        what_is_stored(seconds),
        four_tones(seconds),
        paper_gains(seconds),
        equalisation(seconds, missing),
        frequency_search(seconds),
        varying_tone(seconds),
        integration(seconds),
        sequences(seconds),
        films(missing),
    ]
    yield from beside_two_threads(groups, seconds)


def main() -> int:
    """Exit code 1 with --check if a limit is not reached."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.add_argument("--check", action="store_true", help="exit code 1 if a limit is not reached")
    parser.add_argument("--quick", action="store_true", help="short timings, for a trial")
    arguments = parser.parse_args()
    missing: list[str] = []
    before = os.getloadavg()[0]
    figures = list(measure(0.02 if arguments.quick else 0.6, missing))
    facts = {"simd_target": _core.simd_target(), "load_before": before, "load_after": os.getloadavg()[0]}
    if arguments.json:
        print(json.dumps({**facts, "missing": missing, "figures": [f.record() for f in figures]}, ensure_ascii=False))
    else:
        print_table(figures)
        print("in brackets: from the fastest tenth of both calls")
        for name in dict.fromkeys(missing):
            print(f"{name}: not installed, left out")
        print(", ".join(f"{name} {value}" for name, value in facts.items()))
    return int(arguments.check and missed(figures))


if __name__ == "__main__":
    sys.exit(main())
