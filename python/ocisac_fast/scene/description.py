"""Contents of a scene: lens, lights, surfaces, masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.checks import NotNegative, Positive, Within, checked_class
from ocisac_fast.core.results import Result
from ocisac_fast.light.waveforms import Constant, Waveform
from ocisac_fast.scene.course import check_light
from ocisac_fast.scene.geometry import Array, Pinhole
from ocisac_fast.scene.objects import Mask, Source, Surface


@checked_class
@dataclass(frozen=True)
class Sensor:
    """Conversion of light to stored values: v = gain * T_e * p (DN above dark), eq. 4.

    Args:
        gain: A, DN of linear light per unit of light and second; above 0.
        bit_depth: 1 to 16 bits: values are rounded and clipped; None: floating point.
        full_well: electrons at the white level, where pixels saturate, above 0; None: only the bit depth saturates, and
            there is no shot noise.
        read_noise: electrons, standard deviation; 0 or above. Needs ``full_well``.
        shot_noise: simulate the Poisson statistics of electrons. Needs ``full_well``.
        frame_jitter: frames start up to so many seconds early or late, uniformly distributed; 0 or above.
    """

    gain: Positive
    _: KW_ONLY
    bit_depth: Annotated[int, Within(1, 16)] | None = None
    full_well: Positive | None = None
    read_noise: NotNegative = 0.0
    shot_noise: bool = False
    frame_jitter: NotNegative = 0.0

    def __post_init__(self) -> None:
        if self.full_well is None and (self.read_noise or self.shot_noise):
            raise ValueError("full_well: got None, allowed: electrons at the white level, needed for noise")

    @property
    def noisy(self) -> bool:
        return bool(self.read_noise or self.shot_noise)


@checked_class
@dataclass(frozen=True)
class Ambient:
    """Light I_e that illuminates all surfaces equally.

    Args:
        intensity: I_e, 0 or above.
        waveform: its variation, such as mains flicker.
    """

    intensity: NotNegative = 0.0
    _: KW_ONLY
    waveform: Waveform = field(default_factory=lambda: Constant(1.0))

    def __post_init__(self) -> None:
        check_light(self.waveform)


@dataclass(frozen=True, repr=False)
class Voxels(Result):
    """Points of the scene that pixels see.

    Attributes:
        index: (...) of the voxel's object in ``scene.sources + scene.surfaces``; -1: none.
        points: (..., 3) in the world, m; NaN without an object.
        distance: (...) from the camera, m; infinite without an object.
    """

    index: npt.NDArray[np.int64]
    points: Array
    distance: Array


@dataclass(frozen=True)
class SceneDescription:
    """A camera and its scene; a pixel shows the nearest source or surface on the ray through its centre.

    Args:
        lens: geometry of the camera.
        camera: its timing and tone response; the exposure must be above 0.
        sensor: gain, bit depth and noise.
        sources, surfaces, masks: stored as tuples. A mask attenuates the light of the objects behind it.
        ambient: light on all surfaces.

    Raises:
        ValueError: an object whose middle is not in front of the camera, or no exposure; the message names it.
    """

    lens: Pinhole
    camera: Camera
    sensor: Sensor
    _: KW_ONLY
    sources: Sequence[Source] = ()
    surfaces: Sequence[Surface] = ()
    masks: Sequence[Mask] = ()
    ambient: Ambient = Ambient()

    def __post_init__(self) -> None:
        if self.camera.exposure is None or self.camera.exposure <= 0:
            raise ValueError(f"exposure: got {self.camera.exposure}, allowed: above 0")
        for name in ("sources", "surfaces", "masks"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
            for index, item in enumerate(getattr(self, name)):
                place = item.pose.position
                depth = self.lens.pose.to_object(place)[2]
                if not depth > 0:
                    where = f"{name}[{index}].position"
                    raise ValueError(f"{where}: got {place}, allowed: before the camera (depth {depth:g} m)")

    @property
    def exposure(self) -> float:
        """T_e in seconds."""
        assert self.camera.exposure is not None
        return self.camera.exposure

    @property
    def white_level(self) -> float:
        """DN of full light: the camera's, or the largest value of the bit depth (8 bits if there is none)."""
        return self.camera.white_level or float(2 ** (self.sensor.bit_depth or 8) - 1)

    @property
    def scale(self) -> float:
        """A * T_e: DN above dark per unit of light."""
        return self.sensor.gain * self.exposure

    def voxels(self, pixels: npt.ArrayLike) -> Voxels:
        """Points that pixels see at frame 0: the inverse of ``lens.pixels_of``.

        Args:
            pixels: (..., 2) pixel coordinates (x, y).
        """
        rays = self.lens.rays_of(pixels)
        origin = np.array(self.lens.pose.position)
        distance = np.full(rays.shape[:-1], np.inf)
        index = np.full(rays.shape[:-1], -1, np.int64)
        items: list[Source | Surface] = [*self.sources, *self.surfaces]
        for number_, item in enumerate(items):
            far, x, y = crossing(item, origin, rays)
            nearer = (far < distance) & item.shape.contains(x, y)
            distance, index = np.where(nearer, far, distance), np.where(nearer, number_, index)
        with np.errstate(invalid="ignore"):
            points = origin + np.where(index < 0, np.nan, distance)[..., np.newaxis] * rays
        return Voxels(index, points, distance)


def crossing(item: Source | Surface | Mask, origin: Array, rays: Array) -> tuple[Array, Array, Array]:
    """Intersections of rays from ``origin`` (3,) along ``rays`` (..., 3) with an object's plane: distance, x, y.

    The distance is infinite without an intersection.
    """
    start = item.pose.to_object(origin)
    along = rays @ item.pose.matrix
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -start[2] / along[..., 2]
        distance = np.where(np.isfinite(distance) & (distance > 0), distance, np.inf)
        near = np.where(np.isfinite(distance), distance, 0.0)
    return distance, start[0] + near * along[..., 0], start[1] + near * along[..., 1]
