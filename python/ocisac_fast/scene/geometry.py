"""Geometry: poses, shapes, and the pinhole camera that maps voxels to pixels and back.

Coordinates are those of OpenCV: x to the right, y down, z away from the camera, in metres; pixel (x, y) has its centre
at whole numbers, (0, 0) in the middle of the top left pixel.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.checks import Finite, Positive, Within, checked, checked_class, shown

Array = npt.NDArray[np.float64]
Vector = tuple[Finite, Finite, Finite]


def _vectors(name: str, given: npt.ArrayLike, length: int) -> Array:
    values = np.asarray(given, np.float64)
    if values.ndim == 0 or values.shape[-1] != length:
        raise ValueError(f"{name}: got shape {values.shape}, allowed: (..., {length})")
    return values


def _check_alike(x: Array, y: Array) -> None:
    if np.shape(x) != np.shape(y):
        raise ValueError(f"x, y: got shapes {np.shape(x)} and {np.shape(y)}, allowed: one shape")


MAX_PIXELS = 2**28
Pixels = Annotated[int, Within(1, MAX_PIXELS)]


def _tuple(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(map(float, values))


@checked_class
@dataclass(frozen=True)
class Pose:
    """Position and orientation of an object.

    Args:
        position: of its origin in the world, (x, y, z) in metres.
        rotation: axis times angle in rad (Rodrigues) of the rotation from the object's to the world's coordinates.
    """

    position: Vector = (0.0, 0.0, 0.0)
    rotation: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("position", "rotation"):
            object.__setattr__(self, name, _tuple(getattr(self, name)))

    @property
    def matrix(self) -> Array:
        """(3, 3): world direction = matrix @ direction of the object."""
        x, y, z = self.rotation
        angle = math.sqrt(x * x + y * y + z * z)
        if angle == 0:
            return np.eye(3)
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) / angle
        return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross)

    @checked
    def to_world(self, points: npt.ArrayLike) -> Array:
        """(..., 3) points of the object in world coordinates."""
        return np.asarray(_vectors("points", points, 3) @ self.matrix.T + np.array(self.position))

    @checked
    def to_object(self, points: npt.ArrayLike) -> Array:
        """(..., 3) points of the world in the object's coordinates."""
        return np.asarray((_vectors("points", points, 3) - np.array(self.position)) @ self.matrix)


@checked_class
@dataclass(frozen=True)
class Pinhole:
    """A pinhole camera: the voxel at depth z of its axis appears at focal_length / (z * pixel_pitch) pixels a metre.

    Args:
        columns, rows: resolution in pixels.
        focal_length: m, above 0.
        pixel_pitch: m, above 0.
        principal_point: (x, y) in pixels where the axis meets the sensor; None: the middle.
        pose: of the camera; it looks along its own z.
        velocity: of the camera in the world, m/s. The geometry is constant within a frame, with the camera at its
            position at the frame's time.
        blur: standard deviation of the Gaussian point-spread function in pixels, 0 (sharp) to 100.
    """

    _: KW_ONLY
    columns: Pixels
    rows: Pixels
    focal_length: Positive
    pixel_pitch: Positive
    principal_point: tuple[Finite, Finite] | None = None
    pose: Pose = Pose()
    velocity: Vector = (0.0, 0.0, 0.0)
    blur: Annotated[float, Within(0.0, 100.0)] = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "velocity", _tuple(self.velocity))
        if self.rows * self.columns > MAX_PIXELS:
            raise ValueError(f"rows: got {self.rows} x {self.columns} pixels, allowed: up to {MAX_PIXELS}")
        if self.principal_point is not None:
            object.__setattr__(self, "principal_point", _tuple(self.principal_point))

    @property
    def focal_pixels(self) -> float:
        """Focal length in pixels."""
        return self.focal_length / self.pixel_pitch

    @property
    def centre(self) -> tuple[float, float]:
        """Principal point in pixels."""
        return self.principal_point or ((self.columns - 1) / 2, (self.rows - 1) / 2)

    @checked
    def pixels_of(self, points: npt.ArrayLike) -> Array:
        """Project voxels to pixels.

        Args:
            points: (..., 3) in the world, m.

        Returns:
            (..., 2) pixel coordinates (x, y), not limited to the sensor; NaN for points not in front of the camera.
        """
        seen = self.pose.to_object(points)
        depth = np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan)
        return np.asarray(seen[..., :2] / depth * self.focal_pixels + np.array(self.centre))

    @checked
    def rays_of(self, pixels: npt.ArrayLike) -> Array:
        """Directions of pixels: the inverse of `pixels_of` up to the distance.

        Args:
            pixels: (..., 2) pixel coordinates (x, y).

        Returns:
            (..., 3) unit vectors in the world: a voxel at distance d is position + d * ray.
        """
        offset = (_vectors("pixels", pixels, 2) - np.array(self.centre)) / self.focal_pixels
        ray = np.concatenate([offset, np.ones((*offset.shape[:-1], 1))], axis=-1)
        return np.asarray((ray / np.linalg.norm(ray, axis=-1, keepdims=True)) @ self.pose.matrix.T)


@checked_class
@dataclass(frozen=True)
class Rectangle:
    """Plate of width (along its x) and height (along its y), m, above 0."""

    width: Positive
    height: Positive

    @checked
    def contains(self, x: Array, y: Array) -> npt.NDArray[np.bool_]:
        _check_alike(x, y)
        return np.asarray((np.abs(x) <= self.width / 2) & (np.abs(y) <= self.height / 2))

    @property
    def half_size(self) -> tuple[float, float]:
        return self.width / 2, self.height / 2


@checked_class
@dataclass(frozen=True)
class Disc:
    """Round plate of the given diameter, m, above 0."""

    diameter: Positive

    @checked
    def contains(self, x: Array, y: Array) -> npt.NDArray[np.bool_]:
        _check_alike(x, y)
        return np.asarray(x * x + y * y <= self.diameter**2 / 4)

    @property
    def half_size(self) -> tuple[float, float]:
        return self.diameter / 2, self.diameter / 2


@checked_class
@dataclass(frozen=True)
class Ring:
    """Ring between two circles about its origin; patterns run along it, and `speed` is that at the middle circle.

    Args:
        diameter: of the middle circle, m, above 0.
        width: from the inner to the outer circle, m, above 0 and below the diameter.
    """

    diameter: Positive
    width: Positive

    def __post_init__(self) -> None:
        if self.width >= self.diameter:
            raise ValueError(f"width: got {shown(self.width)}, allowed: below the diameter")

    @checked
    def contains(self, x: Array, y: Array) -> npt.NDArray[np.bool_]:
        _check_alike(x, y)
        radius = np.hypot(x, y)
        return np.asarray(np.abs(radius - self.diameter / 2) <= self.width / 2)

    @property
    def half_size(self) -> tuple[float, float]:
        half = (self.diameter + self.width) / 2
        return half, half


Shape = Rectangle | Disc | Ring
