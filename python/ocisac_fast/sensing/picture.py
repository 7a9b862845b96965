"""Sensing of whole pictures: every light and every texture that is periodic along the rows."""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.camera.linear_light import linear_light
from ocisac_fast.core.arrays import as_grey_frames, box_in_time_order, in_stored_order, stored_box
from ocisac_fast.core.checks import checked
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.regions import Region
from ocisac_fast.lights.sources import detect_sources
from ocisac_fast.sensing.motion import KnownMotion
from ocisac_fast.sensing.region import BackgroundLight, Request, SensedRegion, background_light, check_size, measure
from ocisac_fast.sensing.search import PeriodicRegion, periodic_regions, without_repeats

_MIN_BESIDE = 4  # columns
SEARCHED = 8  # frames
_NOTHING = Region(0, 0, 1, 1)


@checked
def sense(
    frames: npt.ArrayLike,
    camera: Camera,
    *,
    waveform: Literal["tone", "square"] = "tone",
    duty: float = 0.5,
    depth: float = 1.0,
    unlit: npt.ArrayLike | None = None,
    beside: bool = False,
    motion: KnownMotion | None = None,
) -> list[SensedRegion]:
    """Detect every modulated light and every moving periodic texture in a picture, and measure them.

    Lights come from :func:`detect_sources`. Textures are detected as boxes whose columns are periodic, with one
    frequency and free phases, in the first frame minus the mean of up to 8 frames: at least 64 rows, 2.5 cycles, about
    16 columns, and 0.6 of the energy in the fundamental. Static content cancels. In a single frame it does not, and the
    bounds are 5 cycles and 0.8. :func:`sense_region` measures and classifies each box; boxes without a periodic
    component are dropped.

    Args:
        frames: (rows, columns) or (frames, rows, columns), rows in time order, successive frames.
        camera: row time; frame time to compare frames; exposure for ``theory``.
        waveform, duty, depth: of textures and lights, as for ``sense_region``.
        unlit: (rows, columns) or (frames, rows, columns) of the same view without the lights, which gives their
            background.
        beside: measure the background of lights in the columns left and right of their boxes instead.
        motion: what is known of the textures' motion.

    Returns:
        Regions in descending order of ``snr``.
    """
    found = find_periodic(frames, camera)
    return found.measure(frames, Request(waveform, duty, depth, motion), unlit, beside=beside)


@dataclass(frozen=True, slots=True)
class FoundPeriodic:
    """Lights and textures found in the first frames of a recording, to be measured in all of them."""

    camera: Camera  # as given
    part: Region  # of the picture as stored, in which they are
    boxes: list[PeriodicRegion]  # in this part, rows in time order

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the part."""
        turned = self.camera.scan_axis.endswith("x")
        return (self.part.width, self.part.height) if turned else (self.part.height, self.part.width)

    def cut(self, *, beside: bool) -> FoundPeriodic:
        """The same in the smallest part with all boxes, and with the columns ``beside`` them if these are needed."""
        axis, columns = self.camera.scan_axis, self.shape[1]
        boxes = [_with_surroundings(box.region, columns) if beside else box.region for box in self.boxes]
        inner = stored_box(functools.reduce(Region.hull, boxes, boxes[0] if boxes else _NOTHING), self.shape, axis)
        smaller = FoundPeriodic(self.camera, inner._replace(x=self.part.x + inner.x, y=self.part.y + inner.y), [])
        for box in self.boxes:
            stored = stored_box(box.region, self.shape, axis)
            stored = stored._replace(x=stored.x - inner.x, y=stored.y - inner.y)
            moved = box_in_time_order(stored, smaller.shape, axis)
            smaller.boxes.append(dataclasses.replace(box, region=moved))
        return smaller

    def measure(
        self, frames: npt.ArrayLike, request: Request, unlit: npt.ArrayLike | None = None, *, beside: bool = False
    ) -> list[SensedRegion]:
        """:func:`sense` of these boxes; frames of the part."""
        scan_axis, camera = self.camera.scan_axis, self.camera.in_time_order
        pictures = as_grey_frames(frames, "frames", scan_axis)
        dark = None if unlit is None else _same_view(unlit, self.part, scan_axis)
        found = []
        for box in self.boxes:
            bounds = (0.8 * box.cycles / camera.row_period, min(1.25 * box.cycles, 0.499) / camera.row_period)
            asked = dataclasses.replace(request, bounds=bounds)
            region = _measured(pictures, camera, box, dark, beside, self.boxes, asked)
            if region.kind != "unknown" and not region.flags & Flag.WEAK:
                x, y, width, height = stored_box(box.region, self.shape, scan_axis)
                x, y = self.part.x + x, self.part.y + y
                found.append(dataclasses.replace(region, x=x, y=y, width=width, height=height))
        return sorted(found, key=lambda region: -np.nan_to_num(region.snr))


def find_periodic(frames: npt.ArrayLike, camera: Camera) -> FoundPeriodic:
    """Find the boxes of :func:`sense` in the first frames, of which at most 8 are read."""
    if np.ndim(frames) == 1:
        raise ValueError("frames: got 1 dimension, allowed: (rows, columns) or (frames, rows, columns)")
    pictures = as_grey_frames(frames, "frames", camera.scan_axis)[:SEARCHED]
    check_size(pictures, camera)
    in_order = camera.in_time_order
    lights = [
        PeriodicRegion(one.region, one.frequency * camera.row_period, one.frequency_std * camera.row_period)
        for one in detect_sources(pictures, in_order, frame=0)
        if one.reflection_of is None
    ]
    textures = periodic_regions(_changing(pictures, in_order), still=len(pictures) == 1)
    height, width = in_stored_order(pictures, camera.scan_axis).shape[1:]
    return FoundPeriodic(camera, Region(0, 0, width, height), without_repeats([*lights, *textures]))


def _changing(pictures: npt.NDArray[Any], camera: Camera) -> npt.NDArray[np.float64]:
    """The first frame minus the mean of the frames; a single frame is unchanged."""
    first = linear_light(pictures[0], camera)
    if len(pictures) == 1:
        return first
    return np.asarray(first - np.mean([linear_light(one, camera) for one in pictures], axis=0))


def _same_view(unlit: npt.ArrayLike, part: Region, scan_axis: str) -> npt.NDArray[Any]:
    dark = as_grey_frames(unlit, "unlit", scan_axis)
    if np.ndim(unlit) == 1 or in_stored_order(dark, scan_axis).shape[1:] != (part.height, part.width):
        raise ValueError(f"unlit: got shape {np.shape(unlit)}, allowed: (..., {part.height}, {part.width})")
    return dark


def _cut(pictures: npt.NDArray[Any], region: Region) -> npt.NDArray[Any]:
    """(frames, rows, columns, 1)"""
    return region.cut(pictures)[..., np.newaxis]


def _measured(
    pictures: npt.NDArray[Any],
    camera: Camera,
    box: PeriodicRegion,
    dark: npt.NDArray[Any] | None,
    beside: bool,
    every: list[PeriodicRegion],
    request: Request,
) -> SensedRegion:
    """Measure a region, at the frequency of ``detect_sources`` if that is more precise (it models envelopes), and with
    its background if it is a light."""
    cut = _cut(pictures, box.region)
    region = measure(cut, camera, request)
    if not (math.isnan(box.cycles_std) or region.frequency_std <= box.cycles_std / camera.row_period):
        frequency, std = box.cycles / camera.row_period, box.cycles_std / camera.row_period
        request = dataclasses.replace(request, frequency=frequency, frequency_std=std)
        region = measure(cut, camera, request)
    background: BackgroundLight | None = None
    if region.kind == "light" and dark is not None:
        background = background_light(_cut(dark, box.region), camera)
    elif region.kind == "light" and beside:
        background = _beside(pictures, camera, box, every)
    if background is not None:
        region = measure(cut, camera, request, background)
    return region


def _gap_and_reach(region: Region) -> tuple[int, int]:
    """Columns from a box to the first and the last one that is beside it."""
    gap = max(2, region.width // 4)
    return gap, gap + max(region.width // 2, _MIN_BESIDE)


def _with_surroundings(region: Region, columns: int) -> Region:
    """A box with the columns beside it, in a picture of ``columns``."""
    reach = _gap_and_reach(region)[1]
    first, last = max(region.x - reach, 0), min(region.right + reach, columns)
    return region._replace(x=first, width=last - first)


def _beside(
    pictures: npt.NDArray[Any], camera: Camera, box: PeriodicRegion, every: list[PeriodicRegion]
) -> BackgroundLight | None:
    """Light left and right of a box, a few columns away, outside all other boxes; None without four such columns."""
    region = box.region
    gap, reach = _gap_and_reach(region)
    left = range(region.x - reach, region.x - gap)
    right = range(region.right + gap, region.right + reach)
    free = [
        column
        for column in [*left, *right]
        if 0 <= column < pictures.shape[2]
        and not any(region._replace(x=column, width=1).shared_pixels(o.region) for o in every)
    ]
    if len(free) < _MIN_BESIDE:
        return None
    return background_light(pictures[:, region.y : region.bottom][..., free, np.newaxis], camera, pooled=True)
