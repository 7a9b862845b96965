"""The light on a patch as a sum of terms: gain map * waveform * at most one moving pattern (eqs. 1-3, 5-7)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast.light.waveforms import Waveform
from ocisac_fast.scene.description import SceneDescription
from ocisac_fast.scene.geometry import Array, Disc, Rectangle, Shape
from ocisac_fast.scene.objects import Cosine, Grating, Mask, Picture, Plain, Source, Surface
from ocisac_fast.scene.patches import Patch


@dataclass(frozen=True)
class Moving:
    """A pattern that moves in front of the pixels of a patch: its phase at time t is ``periods - rate * t``."""

    pattern: Cosine | Grating | Picture
    rate: float  # Hz, signed, not 0
    periods: Array  # (height, width) phase at time 0
    line: npt.NDArray[np.int64]  # (height, width) rows of a picture; 0 for other patterns


@dataclass(frozen=True)
class Term:
    """Light (DN above dark) ``gains`` * waveform(t) * moving pattern(t), before integration over the exposure."""

    name: str  # its name in the plan
    gains: Array  # (height, width), 0 outside the patch
    waveform: Waveform  # of the light
    moving: Moving | None


def levels_at(pattern: Plain | Cosine | Grating | Picture, periods: Array, line: npt.NDArray[np.int64]) -> Array:
    """Reflectance at a phase in periods."""
    if isinstance(pattern, Plain):
        return np.full(np.shape(periods), pattern.level)
    if isinstance(pattern, Cosine):
        return np.asarray(pattern.low + (pattern.high - pattern.low) * (0.5 + 0.5 * np.cos(2 * np.pi * periods)))
    cell = periods - np.floor(periods)
    if isinstance(pattern, Grating):
        bar = (cell < pattern.duty / 2) | (cell >= 1 - pattern.duty / 2)
        return np.where(bar, pattern.high, pattern.low)
    columns = pattern.levels.shape[1]
    return np.asarray(pattern.levels[line, np.minimum((cell * columns).astype(np.int64), columns - 1)])


def picture_line(pattern: Plain | Cosine | Grating | Picture, y: Array) -> npt.NDArray[np.int64]:
    """Row of a picture at the coordinate y of its object."""
    if not isinstance(pattern, Picture):
        return np.zeros(np.shape(y), np.int64)
    rows = pattern.levels.shape[0]
    return np.asarray(np.floor((y / pattern.height + 0.5) * rows).astype(np.int64) % rows)


def _area(shape: Shape) -> float:
    if isinstance(shape, Rectangle):
        return shape.width * shape.height
    if isinstance(shape, Disc):
        return math.pi * shape.diameter**2 / 4
    return math.pi * shape.diameter * shape.width


def bounce(source: Source, surface: Surface, points: Array, origin: Array) -> Array:
    """Light of a source reflected by a white surface at ``points`` (..., 3), per unit of its waveform."""
    away = points - np.array(source.pose.position)
    distance = np.linalg.norm(away, axis=-1)
    normal = surface.pose.matrix[:, 2]
    side = np.sign((origin - np.array(surface.pose.position)) @ normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        facing = np.maximum(0.0, side * -(away @ normal) / distance)
        leaving = np.abs(away @ source.pose.matrix[:, 2]) / distance
        light = source.intensity * _area(source.shape) * leaving**source.directivity * facing / (np.pi * distance**2)
    return np.where(distance > 0, light, 0.0)


def _way(scene: SceneDescription, patch: Patch) -> tuple[Array, Moving | None]:
    """Product of the static patterns, and the moving one."""
    steady = patch.inside.astype(np.float64)
    moving: list[Moving] = []
    way: list[Surface | Mask] = [scene.masks[index] for index in patch.masks]
    if isinstance(patch.item, Surface):
        way.append(patch.item)
    for item in way:
        x, y = patch.places(item)
        pattern, periods, line = item.pattern, item.periods(x, y), picture_line(item.pattern, item.across(x, y))
        if isinstance(pattern, Plain) or item.rate == 0:
            steady *= levels_at(pattern, periods, line)
        else:
            moving.append(Moving(pattern, item.rate, periods, line))
    if len(moving) > 1:
        raise ValueError(f"masks: got {len(moving)} moving patterns before or on {patch.name}, allowed: one")
    return steady, moving[0] if moving else None


def terms(scene: SceneDescription, patch: Patch) -> Iterator[Term]:
    """The terms of a patch, scaled to v = A * T_e * p."""
    steady, moving = _way(scene, patch)
    seen = scene.scale * steady * patch.item.path_loss.at(patch.distance)
    if isinstance(patch.item, Source):
        yield Term(patch.name, seen * patch.item.intensity, patch.item.waveform, moving)
        return
    if scene.ambient.intensity:
        yield Term(f"{patch.name}, ambient", seen * scene.ambient.intensity, scene.ambient.waveform, moving)
    if patch.item.lit_by_sources:
        points = patch.origin + patch.distance[..., np.newaxis] * patch.rays
        for index, source in enumerate(scene.sources):
            light = bounce(source, patch.item, points, patch.origin)
            yield Term(f"{patch.name}, lit by source {index}", seen * light, source.waveform, moving)
