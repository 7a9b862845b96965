#!/usr/bin/env python3
"""Predicted error rates against wrong chips, over random draws of all that goes wrong outside a laboratory at once.

A draw is a lamp that repeats a packet, filmed in FRAMES frames by `simulate_frames`: mains hum and a PWM lamp,
texture, tilt, a round spot, rise and fall, jitter of the frames' starts, clock error, noise, an exposure of 0.5 to 6
chips that is given, given wrong, or not given; every second one has two or three at once of what cameras and cheap
senders do. Every chip has its log-likelihood ratio L and with it the error rate 1 / (1 + exp(|L|)); by decades of it,
the share of wrong chips is compared with the mean predicted rate. Chips are numbered by the frame's own clock; a
frame may be a chip early or late as a whole, the choice that the phase leaves.

--check: exit status 1 for a wrong payload; with rates, also for a decade whose share is not within a factor of two of
the predicted rate.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import multiprocessing
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from draws import ROW_TIME, ROWS, Draw

from ocisac_fast import transmit
from ocisac_fast.packets import PacketFormat
from ocisac_fast.plots import BLACK, BLUE, picture
from ocisac_fast.receiver.stream import ReceivedFrame, Receiver
from studies.reporting import fill_markers, markdown

FRAMES = 20
PAYLOAD = np.random.default_rng(77).bytes(100)
DECADES = 8  # of the rate told, from 1 down; all below is the last
FACTOR = 2.0
_AT_ONCE = 4  # draws
MIN_WRONG = 10  # wrong chips in a decade, seen or told: fewer prove nothing


@dataclasses.dataclass
class Counts:
    """Chips, wrong chips and wrong chips expected by decades of the rate told; the first decade is 1 to 0.1."""

    chips: npt.NDArray[np.int64] = dataclasses.field(default_factory=lambda: np.zeros(DECADES, np.int64))
    wrong: npt.NDArray[np.int64] = dataclasses.field(default_factory=lambda: np.zeros(DECADES, np.int64))
    expected: npt.NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.zeros(DECADES))
    frames: int = 0
    read: int = 0  # frames with chips
    payloads: int = 0  # draws with a payload
    draws: int = 0
    wrong_payloads: int = 0
    silent: int = 0  # frames with over 5 % wrong chips and a rate told below 1 %

    def add(self, other: Counts) -> None:
        for item in dataclasses.fields(self):
            setattr(self, item.name, getattr(self, item.name) + getattr(other, item.name))

    def calibrated(self, decade: int) -> bool | None:
        """Whether the share of wrong chips is within the factor of the rate told; None: too few to say."""
        wrong, expected = int(self.wrong[decade]), float(self.expected[decade])
        if max(wrong, expected) < MIN_WRONG:
            return None
        return bool(expected / FACTOR <= wrong <= expected * FACTOR)


@dataclasses.dataclass(frozen=True)
class Frame:
    """A frame as it was received: rate told and truth of each chip."""

    result: ReceivedFrame
    told: npt.NDArray[np.float64]
    wrong: npt.NDArray[np.bool_]


def compared(result: ReceivedFrame, begin: float, sent: npt.NDArray[Any], inverted: bool = False) -> Frame:
    """A frame whose first bit begins so many chips after the sender's first (one cycle `sent`).

    The bits of an inverted light may be turned, too.
    """
    if not result.bits:
        return Frame(result, np.zeros(0), np.zeros(0, np.bool_))
    index = round(begin) + np.arange(len(result.bits))
    bits = np.frombuffer(result.bits.encode(), np.uint8) - ord("0")
    shifted = [sent[(index + shift) % sent.size] != bits for shift in (0, -1, 1)]
    shifted += [~wrong for wrong in shifted] if inverted else []
    told = 1 / (1 + np.exp(np.minimum(np.abs(result.llr), 700)))
    return Frame(result, told, min(shifted, key=np.count_nonzero))


def receive(draw: Draw, undo: Callable[..., npt.NDArray[np.uint8]] | None = None) -> Iterator[Frame]:
    """Receive a draw frame by frame; what is read inverted of an inverted light is right.

    ``undo`` is given the draw, the frame, the one before, and the frame before its local tone mapping.
    """
    packet = transmit(PAYLOAD, format=PacketFormat(block_bytes=8))
    receiver = Receiver(draw.told, chip_rate=draw.told_chip_rate, format=packet.format)
    sent, read = draw.sent(packet.chips), draw.device().read_rows()
    before = None
    for start, (pixels, source) in zip(draw.starts(FRAMES), draw.frames(packet.chips, FRAMES), strict=True):
        result = receiver.push(undo(draw, pixels, pixels if before is None else before, source) if undo else pixels)
        before = pixels
        row = np.interp(result.phase, np.arange(ROWS), read) + min(result.phase, 0.0)
        begin = start + row * ROW_TIME - result.exposure / 2
        yield compared(result, begin * draw.chip_rate, sent, draw.level("inverted") > 0)


def counted(draw: Draw) -> Counts:
    """Count the chips of one draw."""
    counts = Counts()
    payloads = []
    for frame in receive(draw):
        counts.frames += 1
        if frame.result.payload is not None:
            payloads.append(frame.result.payload.data)
        if not frame.told.size:
            continue
        decade = np.clip(np.floor(-np.log10(frame.told)).astype(int), 0, DECADES - 1)
        counts.chips += np.bincount(decade, minlength=DECADES)
        counts.wrong += np.bincount(decade[frame.wrong], minlength=DECADES)
        counts.expected += np.bincount(decade, weights=frame.told, minlength=DECADES)
        counts.read += 1
        counts.silent += int(frame.wrong.mean() > 0.05 and frame.result.error_rate < 0.01)
    counts.draws, counts.payloads = 1, int(bool(payloads))
    counts.wrong_payloads = sum(payload != PAYLOAD for payload in payloads)
    return counts


def draw_of(seed: int, kinds: str) -> Draw:
    """The draw of a seed, of one kind or of both in turns."""
    is_of_light = seed % 2 == 0 if kinds == "all" else kinds == "light"
    return Draw.of(seed) if is_of_light else Draw.of_devices(seed)


def measure(chips: int, first: int, processes: int, kinds: str = "all") -> Counts:
    """Draws from a seed on, until at least so many chips are read, a few at once."""
    total, seeds = Counts(), itertools.count(first)
    with multiprocessing.get_context("spawn").Pool(processes or None) as pool:
        while total.chips.sum() < chips:
            for counts in pool.imap(counted, [draw_of(seed, kinds) for seed in itertools.islice(seeds, _AT_ONCE)]):
                total.add(counts)
                text = f"{total.draws} draws, {total.chips.sum()} chips, {total.wrong_payloads} wrong payloads"
                print(text, file=sys.stderr, flush=True)
    return total


def name_of(decade: int) -> str:
    """The rates of a decade."""
    high, low = (f"{100 * 10.0**-k:g} %" for k in (decade, decade + 1))
    return f"below {high}" if decade == DECADES - 1 else "50 % to 10 %" if decade == 0 else f"{high} to {low}"


def table(counts: Counts) -> str:
    """Markdown: a line for each decade, and the totals."""
    rows = []
    for k in range(DECADES):
        chips, good = int(counts.chips[k]), counts.calibrated(k)
        share, told = (f"{value / max(chips, 1):.1e}" for value in (counts.wrong[k], counts.expected[k]))
        words = {None: f"fewer than {MIN_WRONG} wrong, seen and told", True: "yes", False: "**no**"}[good]
        rows.append((name_of(k), str(chips), str(counts.wrong[k]), share, told, words))
    names = ("rate told", "chips", "wrong", "share", "mean rate told", "within a factor of two")
    return (
        f"{markdown('lrrrrl', names, rows)}\n\n"
        f"{counts.chips.sum()} chips of {counts.read} frames ({counts.frames} filmed, {counts.draws} draws), "
        f"{counts.wrong.sum()} wrong; {counts.payloads} draws with a payload in {FRAMES} frames, "
        f"{counts.wrong_payloads} wrong payloads; {counts.silent} frames with over 5 % wrong chips and a rate told "
        "below 1 %."
    )


def draw_picture(path: str, counts: Counts) -> None:
    """Share of wrong chips over the rate told, with 95 % bounds of the count; grey: within the factor."""
    with picture(path, 5.2, 4.2) as figure:
        axes = figure.subplots()
        ends = np.array([10.0 ** -(DECADES + 1), 1.0])
        axes.fill_between(
            ends, ends / FACTOR, ends * FACTOR, color=BLACK, alpha=0.12, lw=0, label="within a factor of two"
        )
        axes.plot(ends, ends, color=BLACK, lw=0.8)
        for k in np.flatnonzero(counts.chips):
            n, wrong = counts.chips[k], counts.wrong[k]
            told, spread = counts.expected[k] / n, 2 * math.sqrt(wrong + 1)
            low, high = max(wrong - spread, 0) / n, (wrong + spread + 2) / n
            axes.plot([told, told], [max(low, 1e-12), high], color=BLUE, lw=1.2)
            if wrong:
                axes.plot([told], [wrong / n], "o", color=BLUE, ms=5)
        axes.set(xscale="log", yscale="log", xlim=ends, ylim=(1e-7, 1), xlabel="error rate told", ylabel="wrong chips")
        axes.legend(loc="upper left")


def main() -> int:
    """Exit code 1 with --check where the answer is not what it should be."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--chips", type=int, default=1_000_000, help="chips to read, at least (default 1000000)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first draw")
    parser.add_argument("--processes", type=int, default=0, help="at once; 0: one for each processor")
    parser.add_argument("--draws", choices=["all", "light", "devices"], default="all", help="default: all")
    parser.add_argument("--picture", help="draw shares over rates to a .png, .svg or .pdf")
    parser.add_argument(
        "--text", help="a Markdown file with '<!-- calibration: table -->', or devices, '<!-- ... end -->'"
    )
    parser.add_argument("--check", choices=["payloads", "rates"], help="exit code 1 for a wrong payload, or rate")
    asked = parser.parse_args()
    counts = measure(asked.chips, asked.first, asked.processes, asked.draws)
    if asked.picture:
        draw_picture(asked.picture, counts)
    if asked.text:
        fill_markers(asked.text, "devices" if asked.draws == "devices" else "calibration", {"table": table(counts)})
    print(table(counts))
    off = [k for k in range(DECADES) if counts.calibrated(k) is False]
    return 1 if asked.check and (counts.wrong_payloads or (asked.check == "rates" and off)) else 0


if __name__ == "__main__":
    sys.exit(main())
