"""Limits of reception: what cameras and cheap senders do to the chips of a lamp, one thing at a time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from calibration import PAYLOAD, receive
from draws import COLUMNS, FRAME_TIME, ROWS, Draw

from ocisac_fast import transmit
from ocisac_fast.chips import ChipClock, chip_llr
from ocisac_fast.core.flags import Flag
from ocisac_fast.packets import PacketFormat
from studies.limits.catalogue import Point, limit, shared_flags

_RATE, _FRAMES = 8e3, 6  # chip/s


def _plain_errors(draw: Draw) -> list[float]:
    """Share of wrong chips of each frame by a detector that knows all but the effect, and believes what is stated."""
    chips = transmit(PAYLOAD, format=PacketFormat(block_bytes=8)).chips
    sent = draw.sent(chips)
    row_time = draw.told.row_period
    period = 1 / (_RATE * row_time)
    around = math.ceil(draw.exposure * _RATE) + 1
    shares = []
    for number, (pixels, _) in enumerate(draw.frames(chips, _FRAMES)):
        begin = (draw.start + number * FRAME_TIME - draw.exposure / 2) * _RATE  # chips at the first row's middle
        first = math.floor(begin) - around
        clock = ChipClock(rows_per_chip=period, phase=(first - begin) * period, exposure_rows=draw.exposure / row_time)
        count = math.ceil(ROWS / period) + 2 * around
        rows = pixels.mean(axis=1, dtype=np.float64)
        dark, light = np.quantile(rows, [0.02, 0.98])
        noise = draw.noise / draw.swing / math.sqrt(COLUMNS)
        llr = chip_llr(
            (rows - dark) / (light - dark), clock, noise=max(noise, 0.01), first=0, count=count, method="mlse"
        )
        whole = slice(around, count - around)
        shares.append(float(np.mean((llr > 0)[whole] != sent[(first + np.arange(count)) % sent.size][whole])))
    return shares


def _read(effect: str, level: float) -> Point:
    """Shares of wrong chips under an effect of this level, and the error rate that the library reports."""
    draw = Draw(_RATE, _RATE, 2.5 / _RATE, 90.0, 1.5, 40.0, 1.234567, {effect: level}, 5)
    frames = list(itertools.islice(receive(draw), _FRAMES))
    told, wrong = (np.concatenate([getattr(frame, name) for frame in frames]) for name in ("told", "wrong"))
    flags = shared_flags(np.array([frame.result.flags for frame in frames], np.uint32))
    return Point(level, float(np.mean(_plain_errors(draw))), float(wrong.mean()), float(told.mean()), flags)


def _panel(effect: str, title: str, sweep: str, levels: tuple[float, ...], spot: float, fails_by: float) -> None:
    def measure() -> Iterator[Point]:
        yield from (_read(effect, level) for level in levels)

    measure.__name__ = effect
    good = 0.003  # of some 1,100 chips
    limit(title, sweep, "share of wrong chips", spot=spot, fails_by=fails_by, good=good, flags=Flag.MODEL_MISFIT)(
        measure
    )


_panel("row-time", "A row time stated wrong", "error of the row time", (0.002, 0.005, 0.01, 0.02, 0.05), 0.01, 0.1)
_panel("late-frames", "Frames that begin late", "jitter / frame time", (1e-4, 1e-3, 0.01, 0.1, 0.5), 0.1, 0.3)
_panel("lens", "Lens correction of the rows", "pulled, share of the height", (0.003, 0.01, 0.03, 0.08), 0.03, 0.2)
_panel("row-pause", "A pause of the read-out", "pause, rows", (2, 5, 10, 20), 10, 0.2)
_panel("exposure-pairs", "Pairs of rows of two exposures", "ratio of the exposures", (1.5, 2, 3, 4), 4, 0.1)
_panel("denoise", "Noise reduction over frames", "share of the frame before", (0.1, 0.2, 0.35, 0.5), 0.5, 0.05)
_panel("hot-rows", "Hot rows", "share of the rows", (0.005, 0.01, 0.02, 0.03), 0.03, 0.1)
_panel("edge-jitter", "Edges that jitter", "jitter, chips", (0.05, 0.1, 0.15, 0.2, 0.3), 0.2, 0.01)
_panel("long-runs", "Bright runs that last longer", "longer, chips", (0.1, 0.2, 0.3, 0.45), 0.45, 0.1)
_panel("chopping", "Chopped light", "frequency, Hz", (20e3, 20.5e3, 21e3, 22e3, 23e3), 20e3, 0.05)
