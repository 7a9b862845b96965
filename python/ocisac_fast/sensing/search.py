"""Detection of regions that are periodic along their columns, for :func:`ocisac_fast.sense`."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.regions import Region

_STRIP = 16  # columns
_MAX_SKIPPED = 4
_ENOUGH = 1 << 21  # max. number of pixels evaluated in a picture
_MIN_ROWS = 64
_MIN_CYCLES = {False: 2.5, True: 5.0}  # in a tile; True: static content is in the picture
_MIN_SHARE = {False: 0.6, True: 0.8}  # of a tile's energy, without slow light
_LOBE = 4  # half the width of a Hann window's main lobe, in half bins


@dataclass(frozen=True, slots=True)
class PeriodicRegion:
    """A region of a picture and the cycles per row of its columns, with the standard error where known."""

    region: Region
    cycles: float
    cycles_std: float = math.nan


def periodic_regions(light: Float64s, still: bool) -> list[PeriodicRegion]:
    """Regions of (rows, columns) whose columns are periodic with one frequency and free phases.

    ``still``: the picture contains static content, much of which resembles a periodic component.

    Tiles of 16 columns and of all rows, a half and a quarter of them are evaluated by the share of their energy in one
    line of the spectrum, with the columns' powers summed. Neighbours of similar frequency are joined and trimmed to the
    area where the line is above half of its height. Repeated detections are dropped.
    """
    rows = light.shape[0]
    step = min(_MAX_SKIPPED, max(1, light.size // _ENOUGH))
    found: list[PeriodicRegion] = []
    for part in (1, 2, 4):
        height = rows // part
        if height < _MIN_ROWS:
            break
        tiles = []
        for top in range(0, rows - height + 1, max(height // 2, 1)):
            tiles += _tiles(light[top : top + height, ::step], top, still, step)
        fresh = [t for t in tiles if not any(_mostly_in(t, other) for other in found)]
        joined = [_trimmed(light, box) for box in _joined(fresh)]
        found += [box for box in joined if box.region.height * box.cycles >= 2.0 and box.region.width > 0]
    return without_repeats(found)


def without_repeats(boxes: list[PeriodicRegion]) -> list[PeriodicRegion]:
    """Boxes in descending order of size without those that repeat a larger one."""
    kept: list[PeriodicRegion] = []
    for box in sorted(boxes, key=lambda one: -one.region.pixels):
        if not any(_again(box, larger) for larger in kept):
            kept.append(box)
    return kept


def _again(box: PeriodicRegion, larger: PeriodicRegion) -> bool:
    """True if the box repeats the larger one, or is a small piece at its edge."""
    small = 4 * box.region.pixels < larger.region.pixels
    return (small or _mostly_in(box, larger)) and _alike(box, larger, 1.0)


def _mostly_in(box: PeriodicRegion, other: PeriodicRegion) -> bool:
    return 2 * box.region.shared_pixels(other.region) > box.region.pixels


def _tiles(light: Float64s, top: int, still: bool, step: int) -> list[PeriodicRegion]:
    """The periodic strips of some rows, from every ``step``-th column."""
    height, columns = light.shape
    place = np.linspace(-1.0, 1.0, height)[:, None]
    level = light - light.mean(axis=0)
    level -= place * ((place * level).sum(axis=0) / (place**2).sum())
    window = np.hanning(height + 2)[1:-1, None]
    power = np.abs(np.fft.rfft(level * window, 2 * height, axis=0)) ** 2
    strip_columns = _STRIP // step
    starts = np.arange(0, columns, strip_columns)
    strips = np.add.reduceat(power, starts, axis=1)  # (bins, strips), bins of half a cycle
    total = strips.sum(axis=0)
    lines = strips.copy()
    lines[: int(2 * _MIN_CYCLES[still])] = 0.0
    peaks = lines.argmax(axis=0)
    found = []
    for strip, (peak, start) in enumerate(zip(peaks, starts, strict=True)):
        near = slice(max(peak - _LOBE, 0), peak + _LOBE + 1)
        if total[strip] > 0.0 and strips[near, strip].sum() > _MIN_SHARE[still] * total[strip]:
            weights = strips[near, strip]
            centre = float((np.arange(near.start, near.start + len(weights)) * weights).sum() / weights.sum())
            width = min(strip_columns, columns - int(start))
            region = Region(step * int(start), top, step * width, height)
            found.append(PeriodicRegion(region, 0.5 * centre / height))
    return found


def _joined(tiles: list[PeriodicRegion]) -> list[PeriodicRegion]:
    """Bounding boxes of tiles that touch and have similar frequencies."""
    groups: list[list[PeriodicRegion]] = []
    for tile in tiles:
        touching = [group for group in groups if any(_alike(tile, other) for other in group)]
        groups = [group for group in groups if group not in touching]
        groups.append([tile, *(other for group in touching for other in group)])
    boxes = (functools.reduce(Region.hull, (tile.region for tile in group)) for group in groups)
    cycles = (float(np.median([tile.cycles for tile in group])) for group in groups)
    return list(map(PeriodicRegion, boxes, cycles))


def _alike(a: PeriodicRegion, b: PeriodicRegion, cycles: float = 0.5) -> bool:
    rows = min(a.region.height, b.region.height)
    return a.region.touches(b.region) and abs(a.cycles - b.cycles) * rows < cycles


def _trimmed(light: Float64s, box: PeriodicRegion) -> PeriodicRegion:
    """Trim the ends where the line is below half of its median: columns first, then rows, one cycle at a time."""
    region = box.region
    part = region.cut(light)
    turned = (part - part.mean(axis=0)) * np.exp(-2j * np.pi * box.cycles * np.arange(region.height))[:, None]
    first, last = _inside(np.abs(turned.mean(axis=0)))
    span = max(1, min(round(1.0 / box.cycles), region.height))
    sums = np.cumsum(np.vstack([np.zeros((1, last - first)), turned[:, first:last]]), axis=0)
    envelope = np.abs(sums[span:] - sums[:-span]).mean(axis=1)
    top, bottom = _inside(envelope)
    start = 0 if top == 0 else top + span // 2
    end = region.height if bottom == len(envelope) else bottom + span // 2
    trimmed = Region(region.x + first, region.y + start, last - first, end - start)
    return PeriodicRegion(trimmed, box.cycles)


def _inside(height: npt.NDArray[Any]) -> tuple[int, int]:
    """First index above half of the 90 % quantile, and the one after the last."""
    above = np.flatnonzero(height >= 0.5 * np.quantile(height, 0.9))
    return int(above[0]), int(above[-1]) + 1
