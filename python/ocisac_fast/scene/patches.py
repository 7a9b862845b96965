"""Patches of pixels: every pixel belongs to one patch, an object with the masks in front of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import numpy.typing as npt

from ocisac_fast.scene.description import SceneDescription, crossing
from ocisac_fast.scene.geometry import Array, Pinhole, Pose
from ocisac_fast.scene.objects import Mask, Source, Surface

_MAX_MASKS = 31


@dataclass(frozen=True)
class Patch:
    """Pixels that see the same object through the same masks."""

    name: str  # of the object
    item: Source | Surface
    masks: tuple[int, ...]  # indices of the masks in front of it
    top: int  # of its rectangle, as left
    left: int
    inside: npt.NDArray[np.bool_]  # (height, width) True for the pixels of the rectangle that belong to it
    distance: Array  # (height, width) from the camera, m
    rays: Array  # (height, width, 3) unit vectors
    origin: Array  # position of the camera

    def places(self, item: Source | Surface | Mask) -> tuple[Array, Array]:
        """(x, y) of the pixels' rays in an object's plane."""
        _, x, y = crossing(item, self.origin, self.rays)
        return x, y


def lens_at(scene: SceneDescription, time: float) -> Pinhole:
    """The lens with the camera's position at a time."""
    lens = scene.lens
    if not any(lens.velocity):
        return lens
    position = np.array(lens.pose.position) + time * np.array(lens.velocity)
    return replace(lens, pose=Pose((float(position[0]), float(position[1]), float(position[2])), lens.pose.rotation))


def _window(lens: Pinhole, item: Source | Surface | Mask) -> tuple[slice, slice]:
    """Rows and columns that may see an object: around its corners, or all if one is beside or behind the camera."""
    half_x, half_y = item.shape.half_size
    corners = item.pose.to_world([(x, y, 0.0) for x, y in product((-half_x, half_x), (-half_y, half_y))])
    pixels = lens.pixels_of(corners)
    if not np.isfinite(pixels).all():
        return slice(0, lens.rows), slice(0, lens.columns)
    low = np.floor(pixels.min(axis=0)).clip(0, (lens.columns, lens.rows))
    high = (np.ceil(pixels.max(axis=0)) + 1).clip(low, (lens.columns, lens.rows))
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _rays(lens: Pinhole, window: tuple[slice, slice]) -> Array:
    y, x = np.mgrid[window]
    return lens.rays_of(np.stack([x, y], axis=-1))


def patches(scene: SceneDescription, lens: Pinhole) -> Iterator[Patch]:
    """All patches in view of ``lens``."""
    shape = (lens.rows, lens.columns)
    origin = np.array(lens.pose.position)
    depth = np.full(shape, np.inf)
    owner = np.full(shape, -1, np.int32)
    items: list[Source | Surface] = [*scene.sources, *scene.surfaces]
    for index, item in enumerate(items):
        window = _window(lens, item)
        distance, x, y = crossing(item, origin, _rays(lens, window))
        nearer = item.shape.contains(x, y) & (distance < depth[window])
        depth[window] = np.where(nearer, distance, depth[window])
        owner[window] = np.where(nearer, index, owner[window])
    before = np.zeros(shape, np.int64)
    if len(scene.masks) > _MAX_MASKS:
        raise ValueError(f"masks: got {len(scene.masks)}, allowed: up to {_MAX_MASKS}")
    for index, mask in enumerate(scene.masks):
        window = _window(lens, mask)
        distance, x, y = crossing(mask, origin, _rays(lens, window))
        before[window] |= (mask.shape.contains(x, y) & (distance < depth[window])).astype(np.int64) << index
    for index, item in enumerate(items):
        window = _window(lens, item)
        mine = owner[window] == index
        for key in np.unique(before[window][mine]):
            inside = mine & (before[window] == key)
            rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
            cut = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
            top, left = window[0].start + int(rows[0]), window[1].start + int(columns[0])
            whole = slice(top, top + int(np.ptp(rows)) + 1), slice(left, left + int(np.ptp(columns)) + 1)
            name = f"source {index}" if index < len(scene.sources) else f"surface {index - len(scene.sources)}"
            masks = tuple(number for number in range(len(scene.masks)) if key >> number & 1)
            inside = inside[cut]
            distance = np.where(inside, depth[whole], 1.0)
            yield Patch(name, item, masks, top, left, inside, distance, _rays(lens, whole), origin)
