"""Geometry: poses, shapes, and the pinhole camera that maps voxels to pixels and back.

Coordinates are those of OpenCV: x to the right, y down, z away from the camera, in metres; pixel (x, y) has its centre
at whole numbers, (0, 0) in the middle of the top left pixel.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.checks import checked, checked_class, shown
from ocisac_fast.scene.checks import hold, number, numbers, whole

Array = npt.NDArray[np.float64]
Vector = tuple[float, float, float]


def _vectors(name: str, given: npt.ArrayLike, length: int) -> Array:
    values = np.asarray(given, np.float64)
    if values.ndim == 0 or values.shape[-1] != length:
        raise ValueError(f"{name}: got shape {values.shape}, allowed: (..., {length})")
    return values


def _check_alike(x: Array, y: Array) -> None:
    if np.shape(x) != np.shape(y):
        raise ValueError(f"x, y: got shapes {np.shape(x)} and {np.shape(y)}, allowed: one shape")


_MAX_PIXELS = 2**28


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
        hold(self, position=numbers("position", self.position, 3), rotation=numbers("rotation", self.rotation, 3))

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
    columns: int
    rows: int
    focal_length: float
    pixel_pitch: float
    principal_point: tuple[float, float] | None = None
    pose: Pose = Pose()
    velocity: Vector = (0.0, 0.0, 0.0)
    blur: float = 0.0

    def __post_init__(self) -> None:
        hold(
            self,
            columns=whole("columns", self.columns, 1, _MAX_PIXELS),
            rows=whole("rows", self.rows, 1, _MAX_PIXELS),
            focal_length=number("focal_length", self.focal_length, 0, open_low=True),
            pixel_pitch=number("pixel_pitch", self.pixel_pitch, 0, open_low=True),
            velocity=numbers("velocity", self.velocity, 3),
            blur=number("blur", self.blur, 0, 100),
        )
        if self.rows * self.columns > _MAX_PIXELS:
            raise ValueError(f"rows: got {self.rows} x {self.columns} pixels, allowed: up to {_MAX_PIXELS}")
        if self.principal_point is not None:
            hold(self, principal_point=numbers("principal_point", self.principal_point, 2))

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

    width: float
    height: float

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            hold(self, **{name: number(name, getattr(self, name), 0, open_low=True)})

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

    diameter: float

    def __post_init__(self) -> None:
        hold(self, diameter=number("diameter", self.diameter, 0, open_low=True))

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

    diameter: float
    width: float

    def __post_init__(self) -> None:
        hold(self, diameter=number("diameter", self.diameter, 0, open_low=True))
        hold(self, width=number("width", self.width, 0, self.diameter, open_low=True))
        if self.width == self.diameter:
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
